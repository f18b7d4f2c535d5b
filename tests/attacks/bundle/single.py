"""An application that is one file and no package."""

from hostile.arena import agent, calm

make_environment = calm
make_agent = agent
