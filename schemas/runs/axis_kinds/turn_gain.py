"""Axis that scales the agent's turning rate; a negative factor reverses it."""

from typing import Literal

from pydantic import Field

from .kind import AxisError, NumberAxis, Rig, Setter


class TurnGainAxis(NumberAxis):
    """Factor on the turning rates that the agent commands; -1: left and right motors are swapped."""

    varies = "turning rates that the agent commands; at -1 left and right motors are swapped"
    applies_to = (
        "`indoor-navigation` with a robot that is commanded turning rates, and environments that have `command_gains`"
    )
    unit = "factor"
    # As of `command_gain`.
    least, most = -1.0, 2.0
    neutral = "1"

    kind: Literal["turn_gain"] = Field(description="`turn_gain`.")

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Returns a function that sets the factor on the robot's turning rate.

        Raises:
            AxisError: The commands have no turning rate.
        """
        gains = rig.command_gains
        built = gains.turn
        if built is None:
            raise AxisError("the robot is commanded no turning rate")

        def set_gain(gain: float | None) -> None:
            gains.turn = built if gain is None else gain

        return set_gain
