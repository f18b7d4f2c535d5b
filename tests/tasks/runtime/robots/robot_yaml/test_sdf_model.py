"""Robots in SDF: they stand and drive as the same robot in URDF does, and errors name the file and what would do."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.robot_stands import Stand, write_robot

from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.robots.robot_lookup import find_robot

from .test_urdf import MAPPING, robot_urdf

INERTIA = "<inertial><mass>{}</mass><inertia><ixx>{}</ixx><iyy>{}</iyy><izz>{}</izz></inertia></inertial>"


def wheel(side: str, y: float) -> str:
    return (
        f'<link name="{side}_wheel"><pose>0 {y} 0 0 0 0</pose>{INERTIA.format(0.3, 5e-4, 5e-4, 5e-4)}'
        '<collision name="c"><geometry><sphere><radius>0.06</radius></sphere></geometry></collision></link>'
        f'<joint name="{side}_joint" type="continuous"><parent>base_link</parent><child>{side}_wheel</child>'
        "<axis><xyz>0 1 0</xyz></axis></joint>"
    )


def robot_sdf(base: str = INERTIA.format(5, 0.05, 0.05, 0.05), more: str = "", shape: str = "") -> str:
    """The robot of the tests of URDF, in SDF; its model stands elsewhere, which robot.yaml overrules."""
    shape = shape or "<box><size>0.2 0.2 0.05</size></box>"
    return (
        f'<?xml version="1.0"?>\n<sdf version="1.7"><model name="cart"><pose>7 8 0.3 0 0 1</pose>'
        f'<link name="base_link">{base}<collision name="c"><geometry>{shape}</geometry></collision></link>'
        f"{wheel('left', 0.12)}{wheel('right', -0.12)}"
        '<link name="caster"><pose>-.08 0 -.04 0 0 0</pose><collision name="c"><geometry><sphere><radius>0.02</radius>'
        '</sphere></geometry></collision></link><joint name="cj" type="fixed"><parent>base_link</parent>'
        f"<child>caster</child></joint>{more}</model></sdf>"
    )


def robot_of(folder: Path, text: str, name: str = "r.sdf", **members: Any) -> Any:
    folder.mkdir(exist_ok=True)
    mapping = MAPPING | {"model": name} | members
    return find_robot(write_robot(folder, mapping, **{name.replace(".", "_"): text}), {}).robot


def test_it_is_the_same_robot_as_in_urdf(tmp_path: Path) -> None:
    sdf = robot_of(tmp_path / "a", robot_sdf()).build().compile()
    urdf = robot_of(tmp_path / "b", robot_urdf(), "r.urdf").build().compile()

    def facts(model: mujoco.MjModel) -> dict[str, Any]:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        heavy = ["base_link", "left_wheel", "right_wheel"]
        base = data.body("base_link")
        return {
            "joints": [(model.joint(each).name, int(model.jnt_type[each])) for each in range(model.njnt)],
            "places": {name: np.round(data.body(name).xpos - base.xpos, 6).tolist() for name in (*heavy, "caster")},
            "masses": {name: round(float(model.body(name).mass[0]), 6) for name in heavy},
            "inertias": {name: np.round(np.sort(model.body(name).inertia), 8).tolist() for name in heavy},
            "axes": np.round(data.xaxis[1:] @ base.xmat.reshape(3, 3), 6).tolist(),
            "solid": int((model.geom_contype > 0).sum()),
        }  # fmt: skip

    assert facts(sdf) == facts(urdf)


def test_it_drives_where_it_is_told(tmp_path: Path) -> None:
    stand = Stand(robot_of(tmp_path, robot_sdf()))
    assert stand.drive((0.3, 0.0), 2.0) < 0.1
    pose = stand.base.read()
    assert pose.x == pytest.approx(0.6, abs=0.15)
    assert abs(pose.y) < 0.05


def test_meshes_collide_with_their_hulls_and_drawn_ones_do_not(tmp_path: Path) -> None:
    folder = tmp_path / "my_cart" / "meshes"
    folder.mkdir(parents=True)
    corners = [(x, y, z) for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.02, 0.02)]
    faces = ["1 2 4", "1 4 3", "5 8 6", "5 7 8", "1 6 2", "1 5 6", "3 4 8", "3 8 7", "1 3 7", "1 7 5", "2 8 4", "2 6 8"]
    lines = [*(f"v {x} {y} {z}" for x, y, z in corners), *(f"f {each}" for each in faces), ""]
    (folder / "base.obj").write_text("\n".join(lines))
    mesh = "<mesh><uri>model://my_cart/meshes/base.obj</uri></mesh>"
    visual = f'<visual name="v"><geometry>{mesh}</geometry></visual>'
    model = (
        robot_of(tmp_path, robot_sdf(base=visual, shape="<mesh><uri>meshes/base.obj</uri></mesh>")).build().compile()
    )
    [solid, *_] = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_MESH.value) & (model.geom_contype > 0))
    assert sorted(np.round(model.geom_aabb[solid, 3:], 4).tolist()) == [0.02, 0.1, 0.1]
    assert ((model.geom_contype == 0) & (model.geom_group == 2)).sum() >= 1
    assert float(model.body("base_link").mass[0]) == pytest.approx(1.0)  # Gazebo's mass of a link that names none


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('<sdf version="1.7"/>', "r.sdf: it has no <world>"),
        (robot_sdf(base=INERTIA.format(5, 1, 1, 9)), r"no body can have the inertia of cart::base_link; correct it"),
        (robot_sdf(shape="<mesh><uri>base.obj</uri></mesh>"), r"there is no base\.obj \(cart::base_link::c\)"),
        (
            robot_sdf(more='<joint name="x" type="fixed"><parent>caster</parent><child>left_wheel</child></joint>'),
            "joint cart::x: link cart::left_wheel hangs on another joint already",
        ),
        (
            robot_sdf(more='<joint name="x" type="fixed"><parent>caster</parent><child>arm</child></joint>'),
            r"there is no frame 'arm' in it; it has left_joint",
        ),
        (
            robot_sdf(shape="<plane/>"),
            "cart::base_link::c is a plane; leave the ground out of a robot, worlds have theirs",
        ),
        (
            robot_sdf(more="<include><uri>model://ground_plane</uri></include>"),
            "cart::ground_plane::link::collision is a plane; leave the ground out",
        ),
        (
            robot_sdf(
                shape="<polyline><point>0 0</point><point>1 0</point><point>0 1</point><height>1</height></polyline>"
            ),
            "cart::base_link::c: robots collide with box, sphere",
        ),
        (
            robot_sdf(more='<link name="arm"/><link name="hand"/>'),
            r"r\.sdf: it has 3 outermost links, base_link, arm and hand; a robot has one outermost link",
        ),
        (
            robot_sdf(
                more='<link name="arm"/><joint name="j" type="fixed"><parent>world</parent><child>arm</child></joint>'
            ),
            "it has 2 outermost links, base_link and arm",
        ),
        (robot_sdf(more='<link name="caster"/>'), "it has two links cart::caster; each link has a name of its own"),
        (
            robot_sdf().replace("</sdf>", '<model name="q"><link name="base_link"/></model></sdf>'),
            "it has 2 models, cart and q; a robot is one model",
        ),
        (robot_sdf(more="<link name='x'><pose>1 2</pose></link>"), r"2: <pose> is '1 2'; 6 finite numbers"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(LaunchError, match=said):
        robot_of(tmp_path, text)


def test_names_that_come_again_are_numbered(tmp_path: Path) -> None:
    box = "<geometry><box><size>.1 .1 .1</size></box></geometry>"
    again = f"<visual>{box}</visual>" * 3 + f'<collision name="c">{box}</collision>'
    model = robot_of(tmp_path, robot_sdf(base=again)).build().compile()
    names = {model.geom(each).name for each in range(model.ngeom)}
    assert {"base_link::visual_drawn", "base_link::visual_drawn_2", "base_link::visual_drawn_3"} <= names
    assert {"base_link::c", "base_link::c_2"} <= names


def test_impossible_inertias_may_be_those_of_the_shapes(tmp_path: Path) -> None:
    wrong = robot_sdf(base=INERTIA.format(5, 1, 1, 9))
    model = robot_of(tmp_path, wrong, impossible_inertia="from_geometry").build().compile()
    assert float(model.body("base_link").mass[0]) == pytest.approx(5.0)
    assert sorted(model.body("base_link").inertia) == pytest.approx(
        sorted(5 / 12 * np.array([0.04 + 0.0025, 0.04 + 0.0025, 0.08]))
    )


def test_files_outside_of_the_robot_are_refused(tmp_path: Path) -> None:
    (tmp_path / "secret.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    with pytest.raises(LaunchError, match=r"secret\.obj"):
        robot_of(tmp_path / "robot", robot_sdf(shape="<mesh><uri>../secret.obj</uri></mesh>"))
