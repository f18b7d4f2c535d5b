"""The robot as a script: pushes the cart under the falling pole.

On a machine that runs jobs the client is installed; in a container image `agent_client.py` lies beside this file.
"""

import os

try:
    from agent_client import connect
except ImportError:
    from prefect_robomaker.tasks.runtime.agents.agent_client import connect

GAINS = [float(os.environ.get("GAIN", "1")) * each for each in (0.1, 4.0, 0.2, 0.8)]
"""Push per metre, radian and their rates; 1 is all that the motor can."""


def main() -> None:
    """Drives the cart-pole until the simulation ends."""
    with connect() as simulation:
        print("balancing in run", os.environ["AWS_ROBOMAKER_SIMULATION_RUN_ID"])  # noqa: T201 (goes to the log)
        for step in simulation:
            state = [*step.observation["position"], *step.observation["velocity"]]
            push = sum(gain * value for gain, value in zip(GAINS, state))  # noqa: B905 (strict is newer than 3.8)
            simulation.act([max(-1.0, min(1.0, push))])


if __name__ == "__main__":
    main()
