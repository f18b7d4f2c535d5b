"""Axis that scales the mass and inertia of the robot."""

from typing import Literal

from pydantic import Field

from .kind import NumberAxis, Rig, Setter


class RobotMassAxis(NumberAxis):
    """Factor on the masses and inertias of all bodies of the robot."""

    varies = "masses and inertias of all bodies of the robot"
    applies_to = "environments with a MuJoCo model and a robot in it"
    unit = "factor"
    # Beyond ten times somebody gave a mass in kg.
    least, most = 0.1, 10.0
    neutral = "1"

    kind: Literal["robot_mass"] = Field(description="`robot_mass`.")

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Returns a function that scales the masses and inertias of the robot's bodies; `None` is as built."""
        bodies = rig.robot_bodies

        def set_factor(factor: float | None) -> None:
            rig.scale("body_mass", bodies, factor)
            rig.scale("body_inertia", bodies, factor)
            rig.derive_constants()

        return set_factor
