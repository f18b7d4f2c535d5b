"""Poses that furniture could take."""

from itertools import product

import numpy as np
import pytest

from prefect_robomaker.schemas.worlds.world import Furniture
from prefect_robomaker.tasks.worldforge.furniture.catalogue import styles_of
from prefect_robomaker.tasks.worldforge.furniture.placed_parts import solids_of
from prefect_robomaker.tasks.worldforge.geometry.parts import Style
from prefect_robomaker.tasks.worldforge.interiors.candidate_poses import around

TURNS = (0.0, np.pi / 2, np.pi, -np.pi / 2)


def piece(kind: str, style: Style, x: float, y: float, quarter: int) -> Furniture:
    return Furniture(
        id=kind, model_type=kind, style=style.name, room="", x=x, y=y, yaw=TURNS[quarter], width_m=style.width_m,
        depth_m=style.depth_m, height_m=style.height_m,
    )  # fmt: skip


def shared_m(one: Furniture, other: Furniture) -> float:
    """How far the solid parts of two pieces reach into each other at most, by the boxes around them."""
    return max(
        float(np.min((np.array(a.size) + b.size) / 2 - np.abs(np.subtract(a.center, b.center))))
        for a, b in product(solids_of(one), solids_of(other))
        if a.solid and b.solid
    )


@pytest.mark.parametrize("style", styles_of("DiningTables"), ids=lambda style: style.name)
def test_chairs_are_pushed_under_their_table_between_its_legs(style: Style) -> None:
    for chair_style, quarter in product(styles_of("DiningChairs"), range(4)):
        table = piece("DiningTables", style, 1.0, 2.0, quarter)
        poses = around(table, chair_style)
        assert len(poses) >= 4
        for pose in poses:
            chair = piece("DiningChairs", chair_style, round(pose.x, 3), round(pose.y, 3), pose.quarter)
            assert shared_m(table, chair) < 0, (chair_style.name, pose)
            distance = abs(np.subtract((table.x, table.y), (chair.x, chair.y)) @ [np.cos(chair.yaw), np.sin(chair.yaw)])
            sides = (table.depth_m / 2, table.width_m / 2)
            assert any(side + chair.depth_m / 2 - distance > 0.1 for side in sides), "it is pushed under"
