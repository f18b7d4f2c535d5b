"""Axis that scales the agent's commands."""

from typing import Literal

from pydantic import Field

from .kind import NumberAxis, Rig, Setter


class CommandGainAxis(NumberAxis):
    """Factor on all commands of the agent, before the robot limits them; 0: the robot is told to do nothing."""

    varies = "all commands of the agent; at 0 the robot does nothing"
    applies_to = "`indoor-navigation`, and environments that have `command_gains`"
    unit = "factor"
    # Below 0 the robot does the opposite; beyond twice as much its limits cut off the rest.
    least, most = -1.0, 2.0
    neutral = "1"

    kind: Literal["command_gain"] = Field(description="`command_gain`.")

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Returns a function that sets the factor on the robot's commands; `None` is as built."""
        gains = rig.command_gains
        built = gains.whole

        def set_gain(gain: float | None) -> None:
            gains.whole = built if gain is None else gain

        return set_gain
