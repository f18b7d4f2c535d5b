"""Axis that scales the friction between robot and floor."""

from typing import Literal

from pydantic import Field

from .kind import NumberAxis, Rig, Setter


class RobotFrictionAxis(NumberAxis):
    """Factor on the friction between the robot and the floor.

    MuJoCo uses the larger friction of two touching geoms, or that of the geom with priority. The factor therefore
    scales both, so that it has an effect on every floor; loose objects may slide more or less easily, too.
    """

    varies = "friction of the robot and of the floor, of which MuJoCo takes the larger where they touch"
    applies_to = "environments with a MuJoCo model, and a robot in it that can touch a floor"
    unit = "factor"
    # Beyond ten times nothing slips any more that did before, and below a hundredth all does.
    least, most = 0.01, 10.0
    neutral = "1"

    kind: Literal["robot_friction"] = Field(description="`robot_friction`.")

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Returns a function that scales the friction of robot and floor where they touch; `None` is as built."""
        geoms, pairs = rig.touching_geoms, rig.touching_pairs

        def set_factor(factor: float | None) -> None:
            rig.scale("geom_friction", geoms, factor)
            rig.scale("pair_friction", pairs, factor)

        return set_factor
