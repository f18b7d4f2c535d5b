"""Axis that scales the force of the robot's motors."""

from typing import Any, Literal

from pydantic import Field

from .kind import NumberAxis, Rig, Setter


class MotorGainAxis(NumberAxis):
    """Factor on the force of all motors of the robot at the same command and speed, including their force limits."""

    varies = "gains of all motors of the robot, and the limits of their forces"
    applies_to = "environments with a MuJoCo model, and a robot in it whose actuators are motors or servos"
    unit = "factor"
    # Servos stiffer than ten times would need shorter steps; weaker than a tenth, no robot moves.
    least, most = 0.1, 10.0
    neutral = "1"
    subject = "force of motors"

    kind: Literal["motor_gain"] = Field(description="`motor_gain`.")

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Returns a function that scales the forces of the robot's motors."""
        return scale_motors(rig, rig.motors, rig.motor_joints)


def scale_motors(rig: Rig, motors: Any, joints: Any) -> Setter:
    """Returns a function that scales the forces of motors, with their limits.

    Args:
        rig: Simulated robot.
        motors: Numbers of the actuators.
        joints: Numbers of the joints whose force limits are scaled, too.
    """

    def set_factor(factor: float | None) -> None:
        for field in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange"):
            rig.scale(field, motors, factor)
        rig.scale("jnt_actfrcrange", joints, factor)

    return set_factor
