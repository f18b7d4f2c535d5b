"""The robot as a program: pushes the cart under the falling pole.

It needs Python 3.8 or newer and `agent_client.py` beside it, nothing else.
"""

import os

from agent_client import connect

GAIN = float(os.environ.get("GAIN", "1"))
GAINS = [GAIN * each for each in (0.1, 4.0, 0.2, 0.8)]
"""Push per metre, radian and their rates; 1 is all that the motor can."""

with connect() as simulation:
    print("driving run", simulation.hello["run_id"])  # noqa: T201 (goes to the robot's log)
    for step in simulation:
        state = [*step.observation["position"], *step.observation["velocity"]]
        push = sum(gain * value for gain, value in zip(GAINS, state))  # noqa: B905 (strict is newer than 3.8)
        simulation.act([max(-1.0, min(1.0, push))])
