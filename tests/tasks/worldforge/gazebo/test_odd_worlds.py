"""Terrain, bodies on bodies, thin things and far places; and what would hold a command or pass as proved."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from io import BytesIO
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image
from pydantic import ValidationError

from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.schemas.worlds.gazebo_notes import GazeboNotes
from prefect_robomaker.schemas.worlds.world import GazeboSource, World
from prefect_robomaker.tasks.runtime.episode.occupancy_map import read_map
from prefect_robomaker.tasks.worldforge.gazebo.convex_parts import voxel_boxes
from prefect_robomaker.tasks.worldforge.gazebo.importing import Start, Wishes, import_gazebo_world
from prefect_robomaker.tasks.worldforge.proofs.guarantees import MAX_DRIFT_M, violations
from prefect_robomaker.tasks.worldforge.proofs.overlaps import drift_m, motion_of_bodies
from prefect_robomaker.tasks.worlds import gazebo_imports
from prefect_robomaker.tasks.worlds.gazebo_imports import GazeboImport, write_gazebo_bundle

GROUND = "<include><uri>model://ground_plane</uri></include>"


def imported(folder: Path, body: str, wishes: Wishes | None = None) -> tuple[World, mujoco.MjModel]:
    """Imports a world with a ground; returns it and the model that jobs load."""
    path = folder / "some.world"
    path.write_text(f'<sdf version="1.7"><world name="w">{GROUND}{body}</world></sdf>')
    world = import_gazebo_world(path, wishes or Wishes(start=Start(0.0, 0.0)), folder / "bundle")
    return world, mujoco.MjModel.from_xml_path(str(folder / "bundle" / "world.xml"))


def boxed(x: float, y: float, z: float) -> str:
    return f"<geometry><box><size>{x} {y} {z}</size></box></geometry>"


def deck(z: float) -> str:
    """A floor at a height, on a base, with a roof 3 m above."""
    return (
        f'<model name="deck"><static>true</static><pose>3 0 {z} 0 0 0</pose><link name="l">'
        f'<collision name="c"><pose>0 0 -0.1 0 0 0</pose>{boxed(8, 8, 0.2)}</collision>'
        f'<collision name="roof"><pose>0 0 3 0 0 0</pose>{boxed(8, 8, 0.2)}</collision></link></model>'
    )


@pytest.mark.parametrize("start", [None, Start(2.0, 0.0)])
def test_a_floor_may_be_high_up(tmp_path: Path, start: Start | None) -> None:
    path = tmp_path / "some.world"
    path.write_text(f'<sdf version="1.7"><world name="w">{deck(2.2)}</world></sdf>')
    world = import_gazebo_world(path, Wishes(start=start), tmp_path / "bundle")
    assert isinstance(world.source, GazeboSource)
    assert world.source.origin_m[2] == pytest.approx(2.2)
    assert world.checks is not None
    assert violations(world.checks) == []
    assert world.checks.reachable_m2 == pytest.approx(7.6**2, abs=2)


def test_a_start_says_which_of_two_floors_is_meant(tmp_path: Path) -> None:
    """Without a height it is the ground below the deck."""
    found = []
    for name, z in (("low", None), ("high", 2.25)):
        (tmp_path / name).mkdir()
        world, _ = imported(tmp_path / name, deck(2.2), Wishes(start=Start(2.0, 0.0, 0.0, z)))
        assert isinstance(world.source, GazeboSource)
        found.append(world.source.origin_m[2])
    assert found == pytest.approx([0.0, 2.2])


def test_a_door_that_was_saved_open_keeps_its_limits(tmp_path: Path) -> None:
    leaf = '<link name="leaf"><pose>3 0 1.1 0 0 0</pose><inertial><mass>9</mass></inertial>' + (
        f'<collision name="c"><pose>0.45 0 0 0 0 0</pose>{boxed(0.9, 0.04, 2)}</collision></link>'
    )
    _, model = imported(
        tmp_path,
        f'<model name="door">{leaf}<joint name="j" type="revolute"><parent>world</parent><child>leaf</child>'
        "<axis><xyz>0 0 1</xyz><limit><lower>-0.1</lower><upper>1.5</upper></limit></axis></joint></model>"
        '<state world_name="w"><model name="door"><pose>0 0 0 0 0 0</pose><link name="leaf">'
        "<pose>3 0 1.1 0 0 1.2</pose></link></model></state>",
    )
    assert model.jnt_range[0].tolist() == pytest.approx([-0.1, 1.5])
    data = mujoco.MjData(model)
    assert data.qpos.tolist() == pytest.approx([1.2], abs=1e-4)
    mujoco.mj_kinematics(model, data)
    assert data.xmat[1][[0, 3]].tolist() == pytest.approx([np.cos(1.2), np.sin(1.2)], abs=1e-4)
    data.qpos[0] = 0.0
    mujoco.mj_kinematics(model, data)
    assert data.xmat[1][[0, 3]].tolist() == pytest.approx([1.0, 0.0], abs=1e-4)


def test_terrain_is_as_high_as_in_gazebo(tmp_path: Path) -> None:
    """The brightest spot has the size's height, the others their share of it, also where none is black."""
    shares = np.full((33, 33), 50, np.uint8)
    shares[:8] = 100  # the first rows of a picture are north
    Image.fromarray(shares).save(tmp_path / "hills.png")
    terrain = "<geometry><heightmap><uri>hills.png</uri><size>10 10 2</size></heightmap></geometry>"
    _, model = imported(
        tmp_path,
        '<model name="hills"><static>true</static><pose>20 0 0 0 0 0</pose><link name="l">'
        f'<collision name="c">{terrain}</collision></link></model>',
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    down = np.array([0.0, 0.0, -1.0])
    heights = [
        10 - mujoco.mj_ray(model, data, np.array([20.0, y, 10.0]), down, None, True, -1, np.zeros(1, np.int32))
        for y in (4.5, 0.0, -4.5)
    ]
    assert heights == pytest.approx([2.0, 1.0, 1.0], abs=0.01)


@pytest.mark.parametrize(("normal", "pose"), [("-1 0 0", "4 0 0 0 0 0"), ("0 0 1", "4 0 0 0 -1.5707963 0")])
def test_an_upright_plane_is_a_wall_on_the_map(tmp_path: Path, normal: str, pose: str) -> None:
    """All that is behind it is solid, however small it is drawn."""
    plane = f"<geometry><plane><normal>{normal}</normal><size>1 1</size></plane></geometry>"
    imported(
        tmp_path,
        f'<model name="wall"><static>true</static><pose>{pose}</pose><link name="l"><collision name="c">{plane}'
        f'</collision></link></model><model name="box"><static>true</static><pose>7 5 0.5 0 0 0</pose><link name="l">'
        f'<collision name="c">{boxed(1, 1, 1)}</collision></link></model>',
    )
    known = read_map(tmp_path / "bundle" / "map.yaml")
    assert known.occupied is not None
    row, wall = round(-known.origin[1] / known.resolution_m), round((4 - known.origin[0]) / known.resolution_m)
    assert known.free[row, : wall - 1].sum() > 80
    assert known.occupied.shape[1] >= wall + 4
    assert not known.free[:, wall:].any()
    assert known.occupied[row, wall : wall + 4].all()


def test_what_hangs_on_a_body_comes_to_rest_with_it(tmp_path: Path) -> None:
    """The cart falls by 2 cm before the world is stored; its mast, on a ball, and the mast's cap stay on it."""

    def link(name: str, z: float, size: str, mass: int) -> str:
        return (
            f'<link name="{name}"><pose>0 0 {z} 0 0 0</pose><inertial><mass>{mass}</mass></inertial>'
            f'<collision name="c">'
            f"<geometry><box><size>{size}</size></box></geometry></collision></link>"
        )

    def joint(parent: str, child: str, kind: str) -> str:
        return (
            f'<joint name="on_{parent}" type="{kind}"><parent>{parent}</parent><child>{child}</child>'
            "<axis><xyz>0 0 1</xyz><dynamics><damping>5</damping></dynamics></axis></joint>"
        )

    world, model = imported(
        tmp_path,
        '<model name="cart"><pose>3 0 0 0 0 0.3</pose>'
        + link("base", 0.12, "0.5 0.3 0.2", 20)
        + link("mast", 0.4, "0.1 0.1 0.1", 1)
        + link("cap", 0.6, "0.1 0.1 0.1", 1)
        + joint("base", "mast", "revolute")
        + joint("mast", "cap", "revolute")
        + "</model>",
    )
    assert isinstance(world.source, GazeboSource)
    assert world.source.held == {}
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    base, mast, cap = (data.body(f"cart_{name}").xpos for name in ("base", "mast", "cap"))
    assert base[2] == pytest.approx(0.1, abs=0.002)
    assert (mast - base).tolist() == pytest.approx([0, 0, 0.28], abs=0.002)
    assert (cap - base).tolist() == pytest.approx([0, 0, 0.48], abs=0.002)
    assert data.joint("cart_cap").xanchor.tolist() == pytest.approx(cap.tolist(), abs=1e-4)
    assert world.checks is not None
    assert violations(world.checks) == []


def test_a_moment_of_inertia_of_nearly_nothing_is_mended(tmp_path: Path) -> None:
    world, _ = imported(
        tmp_path,
        '<model name="dust"><link name="l"><pose>3 0 0.5 0 0 0</pose><inertial><mass>1e-9</mass><inertia>'
        "<ixx>1e-16</ixx><iyy>1e-16</iyy><izz>1e-16</izz></inertia></inertial>"
        f'<collision name="c">{boxed(1, 1, 1)}</collision></link></model>',
    )
    assert isinstance(world.source, GazeboSource)
    assert [left.what for left in world.source.left_out] == ["inertias that were mended"]


def test_a_ball_joint_turns_about_its_anchor(tmp_path: Path) -> None:
    _, model = imported(
        tmp_path,
        '<model name="lamp"><link name="l"><pose>3 0 1 0 0 0</pose><inertial><mass>1</mass></inertial>'
        f'<collision name="c">{boxed(0.1, 0.1, 0.4)}</collision></link>'
        '<joint name="j" type="ball"><pose>0 0 0.5 0 0 0</pose><parent>world</parent><child>l</child></joint></model>',
    )
    assert model.jnt_type.tolist() == [int(mujoco.mjtJoint.mjJNT_BALL)]
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert data.xanchor[0].tolist() == pytest.approx([3, 0, 1.5], abs=1e-4)


def test_thin_things_load_in_jobs(tmp_path: Path) -> None:
    """A picture on a wall has no thickness, a wire no area, and a polyline corners on a straight edge."""
    (tmp_path / "wire.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nv 3 0 0\nv 4 0 0\nf 1 2 3\nf 2 3 4\nf 3 4 5\n")
    points = "".join(f"<point>{x} {y}</point>" for x, y in ((0, 0), (1, 0), (2, 0), (2, 2), (0, 2)))
    line = f"<geometry><polyline>{points}<height>1</height></polyline></geometry>"
    _, model = imported(
        tmp_path,
        '<model name="m"><static>true</static><pose>5 5 0 0 0 0</pose><link name="l">'
        f'<collision name="c">{boxed(1, 1, 1e-7)}</collision><collision name="p">{line}</collision>'
        f'<visual name="v">{boxed(1, 1, 1e-7)}</visual><visual name="q">{line}</visual>'
        '<visual name="w"><geometry><mesh><uri>wire.obj</uri></mesh></geometry></visual></link></model>',
    )
    assert model.ngeom > 4


def test_a_model_that_no_job_could_load_is_not_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "rock.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    broken = b"v 0 0 0\nf 1 1 1\n"
    monkeypatch.setattr("prefect_robomaker.tasks.worldforge.gazebo.visuals._obj", lambda *_: broken)
    mesh = "<geometry><mesh><uri>rock.obj</uri></mesh></geometry>"
    with pytest.raises(ConfigurationError, match="MuJoCo does not accept"):
        imported(tmp_path, f'<model name="m"><link name="l"><visual name="v">{mesh}</visual></link></model>')
    assert not (tmp_path / "bundle").exists()


def test_pictures_that_are_programs_are_not_drawn(tmp_path: Path) -> None:
    """Pillow reads PostScript by starting Ghostscript."""
    (tmp_path / "t.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\nshowpage\n")
    stream = BytesIO()
    Image.new("RGB", (8, 8)).save(stream, "EPS")
    (tmp_path / "u.png").write_bytes(stream.getvalue())
    visuals = "".join(
        f'<visual name="{name}">{boxed(1, 1, 1)}<material><pbr><metal><albedo_map>{name}.png</albedo_map></metal></pbr>'
        "</material></visual>"
        for name in ("t", "u")
    )
    world, _ = imported(tmp_path, f'<model name="m"><link name="l"><pose>5 5 0 0 0 0</pose>{visuals}</link></model>')
    assert isinstance(world.source, GazeboSource)
    [left] = [each for each in world.source.left_out if each.what == "textures that cannot be read"]
    assert left.names == ["t.png: UnidentifiedImageError", "u.png: UnidentifiedImageError"]


@pytest.mark.parametrize("start", [Start(0.0, 0.0), None])
@pytest.mark.parametrize("x", [5.0, 1000.0, 1e11])
def test_a_plane_has_no_end(tmp_path: Path, x: float, start: Start | None) -> None:
    """Robots start anywhere on it, and a world may be far from its file's origin."""
    box = f'<model name="m"><static>true</static><pose>{x} 0 0.5 0 0 0</pose><link name="l"><collision name="c">{boxed(1, 1, 1)}</collision></link></model>'  # noqa: E501
    world, _ = imported(tmp_path, box, Wishes(start=start))
    assert world.checks is not None
    assert world.checks.origin_clear


@pytest.mark.parametrize("kind", ["mjWARN_BADQPOS", "mjWARN_BADQVEL", "mjWARN_BADQACC"])
def test_what_flies_away_in_a_proof_did_not_stay(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """MuJoCo puts everything back when numbers become too large: that must not pass as stillness."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="still"><joint type="ball"/><geom size="0.1"/></body>'
        '<body name="thrown"><freejoint/><geom size="0.1"/></body></worldbody></mujoco>'
    )

    def settled(model: mujoco.MjModel, data: mujoco.MjData, *_: float) -> None:
        warning = data.warning[getattr(mujoco.mjtWarning, kind)]
        warning.number, warning.lastinfo = 1, 5  # within the free joint, in positions and in velocities

    monkeypatch.setattr("prefect_robomaker.tasks.worldforge.proofs.overlaps._settle", settled)
    still, thrown = drift_m(model, 2.0).tolist()
    assert still == 0
    assert thrown > MAX_DRIFT_M
    ways, _ = motion_of_bodies(model, 2.0)
    assert ways == {"still": 0, "thrown": np.inf}


def test_trees_that_are_kilometres_apart_need_no_memory_between_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("prefect_robomaker.tasks.worldforge.gazebo.convex_parts._MOST_CELLS", 1_000_000, raising=False)
    tree = np.array([[[0, 0, 0], [0.1, 0, 0], [0, 0, 5.0]], [[0, 0, 0], [0, 0.1, 0], [0, 0, 5.0]]])
    forest = np.concatenate([tree + away for away in np.array([(0, 0, 0), (9000.0, 0, 0), (0, 9000.0, 400.0)])])
    assert len(voxel_boxes(forest, 0.08)) == 3


@pytest.mark.parametrize(
    "notes",
    [
        {"goals": {"x": [float("nan"), 1.0]}},
        {"goals": {"x": [1.0, float("inf")]}},
        {"rooms": {"r": {"polygon": [[0, 0], [1, 0], [1, 0], [0, 0]]}}},
    ],
)
def test_notes_of_no_place_are_refused(notes: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        GazeboNotes.model_validate(notes)


def test_an_import_that_waits_for_ever_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes no processor time, so its own limits do not end it."""
    (tmp_path / "waits_for_ever.py").write_text("import time\ntime.sleep(3600)\n")
    monkeypatch.setattr(gazebo_imports, "_PROGRAM", "waits_for_ever")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    world = tmp_path / "some.world"
    world.write_text("<sdf/>")
    with pytest.raises(ConfigurationError, match="takes too long"):
        write_gazebo_bundle(GazeboImport(world), tmp_path / "bundle", most_s=1.0)
