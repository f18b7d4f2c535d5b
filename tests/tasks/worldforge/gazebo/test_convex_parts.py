"""Collision shapes of meshes keep the form of their mesh."""

import mujoco
import numpy as np
import pytest
from helpers.gazebo_house import WALLS, triangles_of

from prefect_robomaker.tasks.worldforge.gazebo.convex_parts import BoxPart, ConvexPart, convex_parts, voxel_boxes

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false


def compiled(parts: list[ConvexPart]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A model of the parts alone."""
    spec = mujoco.MjSpec()
    for number, part in enumerate(parts):
        mesh = spec.add_mesh(name=f"m{number}")
        mesh.uservert = part.corners.ravel().tolist()
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"m{number}")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def share_of_rays_off(parts: list[ConvexPart], triangles: np.ndarray, *, count: int = 600) -> float:
    """Share of level rays from around a mesh that hit its parts more than 2 cm from where they hit the mesh."""
    import trimesh

    mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles))
    model, data = compiled(parts)
    dice = np.random.default_rng(3)
    low, high = mesh.bounds
    off = 0
    for _ in range(count):
        angle, target = dice.uniform(0, 2 * np.pi), dice.uniform(low, high)
        ray = np.array([np.cos(angle), np.sin(angle), 0.0])
        start = target - ray * 30.0
        corners = mesh.triangles
        wanted = _first_hit(corners, start, ray)
        found = mujoco.mj_ray(model, data, start, ray, None, True, -1, np.zeros(1, np.int32))
        off += (wanted is None) != (found < 0) or (wanted is not None and abs(wanted - found) > 0.02)
    return off / count


def _first_hit(triangles: np.ndarray, start: np.ndarray, ray: np.ndarray) -> float | None:
    base, one, two = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    cross = np.cross(ray, two)
    scale = (one * cross).sum(1)
    scale = np.where(np.abs(scale) > 1e-12, scale, np.inf)  # rays along a triangle do not hit it
    u = ((start - base) * cross).sum(1) / scale
    around = np.cross(start - base, one)
    v = around @ ray / scale
    t = (two * around).sum(1) / scale
    good = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return float(t[good].min()) if good.any() else None


def test_walls_of_an_open_shell_stay_walls() -> None:
    """A hull would fill the rooms; walls may be off for 0.2 % of level rays."""
    triangles = np.array([each for box in WALLS for each in triangles_of(box, is_open=box[2] == 0)])
    parts = convex_parts(triangles).parts
    assert len(parts) <= 5 * len(WALLS)
    assert all(isinstance(part, BoxPart) for part in parts)
    assert share_of_rays_off(parts, triangles) <= 0.002


def test_a_round_room_keeps_its_inside() -> None:
    import trimesh

    ring = trimesh.creation.annulus(2.0, 2.2, 2.5, sections=48)
    parts = convex_parts(np.asarray(ring.triangles)).parts
    assert share_of_rays_off(parts, np.asarray(ring.triangles)) <= 0.01


def test_convex_pieces_stay_whole_and_boxes_become_boxes() -> None:
    import trimesh

    ball = trimesh.creation.icosphere(2).triangles
    box = np.array(triangles_of((3, 0, 0, 4, 1, 2)))
    parts = convex_parts(np.concatenate([np.asarray(ball), box])).parts
    assert len(parts) == 2
    [only] = [part for part in parts if isinstance(part, BoxPart)]
    assert sorted(only.half.tolist()) == pytest.approx([0.5, 0.5, 1.0], abs=1e-4)


def test_a_leg_that_meets_a_table_top_in_a_corner_stays_one_box() -> None:
    boxes = [(-0.4, -0.3, 0.7, 0.4, 0.3, 0.75), (-0.4, -0.3, 0.0, -0.35, -0.25, 0.7)]
    parts = convex_parts(np.array([each for box in boxes for each in triangles_of(box)])).parts
    assert [type(part) for part in parts] == [BoxPart, BoxPart]


def test_nothing_grows() -> None:
    """Bodies that move would be thrown if their shapes grew: no corner of a part is outside of its closed mesh."""
    table = np.array([
        each
        for box in ((-0.8, -0.4, 0.72, 0.8, 0.4, 0.76), (-0.78, -0.38, 0.0, -0.7, -0.3, 0.72))
        for each in triangles_of(box)
    ])  # fmt: skip
    corners = np.concatenate([part.corners for part in convex_parts(table).parts])
    assert (corners >= table.reshape(-1, 3).min(axis=0) - 1e-3).all()
    assert (corners <= table.reshape(-1, 3).max(axis=0) + 1e-3).all()
    leg = corners[corners[:, 2] < 0.7]
    assert leg[:, 0].max() <= -0.7 + 1e-3


def test_boxes_on_a_grid_cover_a_surface_within_a_cell() -> None:
    import trimesh

    torus = np.asarray(trimesh.creation.torus(1.0, 0.3).triangles)
    boxes = voxel_boxes(torus, 0.05)
    corners = np.concatenate([part.corners for part in boxes])
    assert len(boxes) < 5000
    assert (corners.min(axis=0) >= torus.reshape(-1, 3).min(axis=0) - 0.05 - 1e-9).all()
    assert (corners.max(axis=0) <= torus.reshape(-1, 3).max(axis=0) + 0.05 + 1e-9).all()
    middles = torus.mean(axis=1)
    inside = [
        (np.abs(middles - part.center) <= part.half + 1e-9).all(axis=1) for part in boxes if isinstance(part, BoxPart)
    ]
    assert np.any(inside, axis=0).all()


def test_meshes_of_nothing_have_no_parts() -> None:
    assert convex_parts(np.zeros((4, 3, 3))).parts == []


def test_fine_meshes_do_not_vanish() -> None:
    """Each face of this bowl is smaller than a square centimetre; a screw beside it is left out."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.15)
    bowl = np.asarray(ball.triangles)[ball.triangles_center[:, 2] < 0.05]
    screw = np.asarray(trimesh.creation.annulus(0.001, 0.004, 0.01, sections=32).triangles) + np.array([1.0, 0, 0])
    found = convex_parts(np.concatenate([bowl, screw]))
    assert found.is_coarse
    assert len(found.parts) < 400
    assert max(part.corners[:, 0].max() for part in found.parts) < 0.2
    middles = bowl.mean(axis=1)
    inside = np.zeros(len(bowl), np.bool_)
    for part in found.parts:
        assert isinstance(part, BoxPart)
        inside |= (np.abs((middles - part.center) @ part.rotation) <= part.half + 1e-3).all(axis=1)
    assert inside.mean() > 0.99

    loose = convex_parts(bowl, is_loose=True)
    assert not loose.is_coarse
    corners = np.concatenate([part.corners for part in loose.parts])
    assert len(loose.parts) > 1000
    assert np.linalg.norm(corners, axis=1).max() <= 0.1501  # nothing grows
