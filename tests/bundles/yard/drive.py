"""The robot of the yard as a program on the agent socket."""

import os

from yard import command

from prefect_robomaker.tasks.runtime.agents.agent_client import connect

sabotage = os.environ.get("SABOTAGE", "")
if sabotage != "gone":
    with connect() as simulation:
        for step in simulation:
            simulation.act(list(command(step.observation["place"], sabotage)))
