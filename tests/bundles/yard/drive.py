"""The robot of the yard, as a program on the agent socket: it needs nothing but Python and the client.

In a container image `agent_client.py` lies on its path.
"""

import os

SPEED_MPS = 0.6


def command(place, sabotage):
    """The velocity in m/s, [x, y], that the robot wants at a place."""
    if sabotage == "idle":
        return [0.0, 0.0]
    if sabotage == "blind":
        return [SPEED_MPS, 0.0]
    if sabotage == "nan":
        return [float("nan")] * 2
    if sabotage == "reversed":
        return [0.0, -SPEED_MPS]
    return [0.0, SPEED_MPS] if place[1] < 0.45 else [SPEED_MPS, 0.0]


def main():
    """Drives until the simulation ends."""
    try:
        from agent_client import connect
    except ImportError:
        from prefect_robomaker.tasks.runtime.agents.agent_client import connect

    sabotage = os.environ.get("SABOTAGE", "")
    if sabotage != "gone":
        with connect() as simulation:
            for step in simulation:
                simulation.act(command(step.observation["place"], sabotage))


if __name__ == "__main__":
    main()
