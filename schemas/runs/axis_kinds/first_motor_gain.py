"""Axis that scales the force of the robot's first motor only."""

from typing import Literal

from pydantic import Field

from .kind import NumberAxis, Rig, Setter
from .motor_gain import scale_motors


class FirstMotorGainAxis(NumberAxis):
    """Factor on the force of the robot's first motor at the same command and speed, including its force limits."""

    varies = "gain of the first motor of the robot's model, a left wheel's of Scout, and the limit of its force"
    applies_to = "environments with a MuJoCo model, and a robot in it whose actuators are motors or servos"
    unit = "factor"
    # As of `motor_gain`, but that a robot may move with one motor dead.
    least, most = 0.0, 10.0
    neutral = "1"
    subject = "force of motors"

    kind: Literal["first_motor_gain"] = Field(description="`first_motor_gain`.")

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Returns a function that scales the force of the robot's first motor."""
        return scale_motors(rig, *rig.first_motor)
