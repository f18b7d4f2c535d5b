"""Axis for the delay between the agent's commands and the motors."""

from typing import Literal

from pydantic import Field

from .kind import NumberAxis, Rig, Setter


class MotorDelayAxis(NumberAxis):
    """Time in seconds that a command takes from the agent to the motors; it is rounded up to 10 ms."""

    varies = "time from the agent's command to the motors, rounded up to 10 ms"
    applies_to = "`indoor-navigation`, and environments that have `command_delay`"
    unit = "s"
    # Robots that are slower to obey than a second are driven by somebody far away.
    least, most = 0.0, 1.0
    neutral = "0"

    kind: Literal["motor_delay_s"] = Field(description="`motor_delay_s`.")

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Returns a function that sets the delay of the robot's commands in seconds; `None` is as built."""
        commands = rig.commands
        built = commands.delay_s

        def set_delay(delay_s: float | None) -> None:
            commands.delay_s = built if delay_s is None else delay_s

        return set_delay
