"""Polylines with holes and cones collide as they look."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from prefect_robomaker.tasks.sdf.polylines import parts_of
from prefect_robomaker.tasks.sdf.sdf_types import Geometry
from prefect_robomaker.tasks.worldforge.gazebo.importing import Start, Wishes, import_gazebo_world
from prefect_robomaker.tasks.worldforge.gazebo.prisms import prism_parts, prism_triangles

YARD = ((0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (3.0, 7.0), (0.0, 6.0))
HOLES = [((1.0, 1.0), (2.0, 1.0), (2.0, 5.0), (1.0, 5.0)), ((4.0, 4.5), (3.5, 2.0), (5.0, 3.0))]
SHED = ((8.0, 0.0), (9.0, 0.0), (9.0, 1.0), (8.0, 1.0))


def test_the_pieces_fill_the_outline_and_leave_its_holes() -> None:
    shape = Geometry("prism", (2.0,), outlines=parts_of([YARD, *HOLES, SHED]))
    area_m2 = 6 * 6 + 3 - 4 - 1.625 + 1
    volumes = [ConvexHull(part.corners).volume for part in prism_parts(shape)]
    assert sum(volumes) == pytest.approx(area_m2 * 2)
    surface = trimesh.Trimesh(**trimesh.triangles.to_kwargs(prism_triangles(shape)))
    assert surface.volume == pytest.approx(area_m2 * 2)


def solid_at(folder: Path, body: str, spots: list[tuple[float, float]]) -> list[float]:
    """Heights of what collides, over some spots of an imported world."""
    path = folder / "some.world"
    path.write_text(
        '<sdf version="1.12"><world name="w"><include><uri>model://ground_plane</uri></include><model name="m">'
        f'<static>true</static><link name="l">{body}</link></model></world></sdf>'
    )
    import_gazebo_world(path, Wishes(start=Start(-3.0, 0.0)), folder / "bundle")
    model = mujoco.MjModel.from_xml_path(str(folder / "bundle" / "world.xml"))
    model.geom_group[:] = np.where((model.geom_contype == 0) & (model.geom_conaffinity == 0), 1, 0)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    groups, down = np.array([1, 0, 0, 0, 0, 0], np.uint8), np.array([0.0, 0.0, -1.0])
    return [
        9 - mujoco.mj_ray(model, data, np.array([x + 3.0, y, 9.0]), down, groups, True, -1, np.zeros(1, np.int32))
        for x, y in spots
    ]


def test_a_wall_with_a_yard_in_it_has_the_yard(tmp_path: Path) -> None:
    lines = "".join(
        f"<polyline>{''.join(f'<point>{x} {y}</point>' for x, y in ring)}<height>2</height></polyline>"
        for ring in (YARD, *HOLES, SHED)
    )
    body = f'<collision name="c"><geometry>{lines}</geometry></collision><visual name="v"><geometry>{lines}</geometry></visual>'  # noqa: E501
    heights = solid_at(tmp_path, body, [(0.5, 3), (1.5, 3), (4.2, 3.2), (5.5, 5.5), (7, 0.5), (8.5, 0.5)])
    assert heights == pytest.approx([2, 0, 0, 2, 0, 2], abs=1e-3)


def test_a_wall_of_too_many_pieces_has_no_gaps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It became half of its pieces, and robots drove through the rest."""
    monkeypatch.setattr("prefect_robomaker.tasks.worldforge.gazebo.solids.MOST_SOLIDS", 250)
    monkeypatch.setattr("prefect_robomaker.tasks.worldforge.gazebo.solids._FIRST_PITCH_M", 0.06)  # is doubled
    turns = 2 * np.pi * np.arange(150) / 150
    lines = "".join(
        f"<polyline>{''.join(f'<point>{6 + far * np.cos(a):.4f} {far * np.sin(a):.4f}</point>' for a in turns)}"
        "<height>0.5</height></polyline>"
        for far in (1.2, 0.9)
    )
    spots = [(6 + 1.05 * np.cos(a), 1.05 * np.sin(a)) for a in 2 * np.pi * np.arange(40) / 40]
    heights = solid_at(tmp_path, f'<collision name="c"><geometry>{lines}</geometry></collision>', [*spots, (6.0, 0.0)])
    assert min(heights[:-1]) > 0.3
    assert heights[-1] == pytest.approx(0, abs=1e-3)


def test_a_cone_is_pointed(tmp_path: Path) -> None:
    cone = "<geometry><cone><radius>1</radius><length>2</length></cone></geometry>"
    body = f'<collision name="c"><pose>4 0 1 0 0 0</pose>{cone}</collision><visual name="v"><pose>4 0 1 0 0 0</pose>{cone}</visual>'  # noqa: E501
    heights = solid_at(tmp_path, body, [(4.003, 0.004), (4.5, 0.01), (4.01, 0.75), (4.9, 0.9)])
    assert heights == pytest.approx([2, 1, 0.5, 0], abs=0.02)
    shape = trimesh.Trimesh(**trimesh.triangles.to_kwargs(prism_triangles(Geometry("cone", (1.0, 2.0)))))
    assert shape.volume == pytest.approx(np.pi * 2 / 3, rel=0.01)
