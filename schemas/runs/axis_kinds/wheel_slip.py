"""Slip of the wheels: they turn as they are told, and the floor gets less of it."""

from typing import Literal

from pydantic import Field

from .kind import NumberAxis, Rig, Setter


class WheelSlipAxis(NumberAxis):
    """Share of the wheels' turning that does not move the robot: it drives and turns less far than its encoders say."""

    varies = "share of the wheels' turning that does not move the robot; `wheel_velocity` does not tell"
    applies_to = (
        "`indoor-navigation` with a robot on a left and a right side of wheels, and environments with `wheel_slip`"
    )
    unit = "share"
    # A robot that transmits less than a tenth stands in mud, and its runs show nothing but that.
    least, most = 0.0, 0.9
    neutral = "0"

    kind: Literal["wheel_slip"] = Field(description="`wheel_slip`.")

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Returns a function that sets the slip of the robot's wheels; `None` is as built."""
        wheels = rig.wheels
        built = wheels.slip

        def set_slip(slip: float | None) -> None:
            wheels.slip = built if slip is None else slip

        return set_slip
