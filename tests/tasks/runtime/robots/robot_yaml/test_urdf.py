"""Robots in URDF as people have them: what is wrong with a file is told with its line, value and remedy."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from helpers.robot_stands import Stand, write_robot

from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.robots.robot import Robot
from prefect_robomaker.tasks.runtime.robots.robot_lookup import find_robot

MAPPING: dict[str, Any] = {
    "version": 1,
    "model": "r.urdf",
    "base": "base_link",
    "footprint": {"radius_m": 0.17},
    "spawn": {"height_m": 0.06},
    "actuators": [
        {"joint": "left_joint", "kind": "velocity", "gain": 4, "force_limit": 2},
        {"joint": "right_joint", "kind": "velocity", "gain": 4, "force_limit": 2},
    ],
    "drive": {
        "kind": "differential", "left": ["left_joint"], "right": ["right_joint"], "wheel_radius_m": 0.06,
        "track_width_m": 0.24, "max_linear_mps": 0.4, "max_angular_radps": 1.5,
    },
    "sliding": ["caster"],
}  # fmt: skip


def inertial(mass: Any, xx: Any, yy: Any, zz: Any) -> str:
    moments = f'ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"'
    return f'<inertial><mass value="{mass}"/><inertia {moments}/></inertial>'


def wheel(side: str, y: float) -> str:
    return f"""<link name="{side}_wheel">{inertial(0.3, 5e-4, 5e-4, 5e-4)}
<collision><geometry><sphere radius="0.06"/></geometry></collision></link>
<joint name="{side}_joint" type="continuous"><parent link="base_link"/><child link="{side}_wheel"/>
<origin xyz="0 {y} 0"/><axis xyz="0 1 0"/></joint>"""


def robot_urdf(base: str = "", more: str = "") -> str:
    """A robot whose base begins in line 6, with what a test adds to the base in line 8 and to the robot at the end."""
    return f"""<?xml version="1.0"?>
<!-- A header
     of two lines -->
<robot name="r">
  <!-- a comment -->
  <link
    name="base_link">{inertial(5, 0.05, 0.05, 0.05)}<collision><geometry><box size=".2 .2 .05"/></geometry></collision>
    {base}
  </link>
  {wheel("left", 0.12)}
  {wheel("right", -0.12)}
  <link name="caster"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <joint name="cj" type="fixed"><parent link="base_link"/><child link="caster"/><origin xyz="-.08 0 -.04"/></joint>
  {more}
</robot>"""


MakeUrdf = Callable[..., Robot]


@pytest.fixture
def make_urdf(tmp_path: Path) -> MakeUrdf:
    def make(text: str, **members: Any) -> Robot:
        return find_robot(write_robot(tmp_path, MAPPING | members, r_urdf=text), {}).robot

    return make


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    """The folder of meshes of the robot's package."""
    folder = tmp_path / "my_cart" / "meshes"
    for name, size_m in (("visual/base.stl", 0.2), ("collision/base.stl", 0.1), ("visual/a b.v2.stl", 0.2)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        trimesh.creation.box((size_m, size_m, 0.05)).export(folder / name)
    trimesh.creation.box((240.0, 240.0, 50.0)).export(folder / "mm.stl")
    for name, corners, faces in (
        ("flat.stl", [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]], [[0, 1, 2], [1, 3, 2]]),
        ("triangle.stl", [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]]),
        ("line.stl", [[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0]], [[0, 1, 2], [1, 2, 3]]),
    ):
        trimesh.Trimesh(corners, faces, process=False).export(folder / name)
    (folder / "empty.stl").write_bytes(bytes(84))
    return folder


def drawn(name: str, scale: str = "") -> str:
    return f'<visual><geometry><mesh filename="{name}"{scale}/></geometry></visual>'


def solid(name: str, scale: str = "") -> str:
    return drawn(name, scale).replace("visual>", "collision>")


@pytest.mark.parametrize(
    ("base", "more", "message"),
    [
        ('<visual><origin xyz="0 0"/><geometry><sphere radius="1"/></geometry></visual>', "", ":8: .*'origin', line 8"),
        ("", '<link name="x"><inertial><mass value="1"/></inertial></link>', r":20: .*missing element: 'inertia'"),
        (drawn("package://my_cart/none.stl"), "", ":8: there is no file"),
        (solid("base.dae"), "", ":8: the mesh 'base.dae' cannot be read"),
        ("<visual>", "", "mismatched tag: line 9, column"),
        ("", '<joint name="x" type="fixed"><parent link="none"/><child link="caster"/></joint>', ":20: "),
    ],
)
def test_errors_have_the_line_of_the_file(make_urdf: MakeUrdf, base: str, more: str, message: str) -> None:
    with pytest.raises(LaunchError, match=rf"r\.urdf(:| ){message}|r\.urdf: .*{message}|r\.urdf{message}"):
        make_urdf(robot_urdf(base, more))


def test_an_error_that_only_compiling_shows_has_the_line_of_its_part(make_urdf: MakeUrdf) -> None:
    link = f'<link name="x">{inertial(1, 1, 1, 1)}<visual><geometry><sphere radius="0"/></geometry></visual></link>'
    joint = '<joint name="y" type="fixed"><parent link="base_link"/><child link="x"/></joint>'
    with pytest.raises(LaunchError, match=r"r\.urdf:20: MuJoCo cannot"):
        make_urdf(robot_urdf(more=f"{link}\n{joint}"))


@pytest.mark.parametrize("depth", [200, 1000, 100_000])
def test_elements_in_elements_without_end_are_one_error(make_urdf: MakeUrdf, depth: int) -> None:
    nested = "<visual>" * depth + "</visual>" * depth
    with pytest.raises(LaunchError, match=r"r\.urdf:\d+: .*<visual> is nested more than 100 deep"):
        make_urdf(robot_urdf(more=nested))


# xacro


@pytest.mark.parametrize(
    ("text", "line", "told"),
    [
        (robot_urdf().replace('"caster"', '"${prefix}caster"'), 18, 'name="${prefix}caster" of <link>'),
        (robot_urdf(drawn("$(find my_cart)/base.stl")), 8, "$(find my_cart)/base.stl"),
        (robot_urdf(more="<xacro:wheel side='left'/>"), 20, "<xacro:wheel>"),
        (
            robot_urdf(more="<x:wheel/>").replace("<robot", '<robot xmlns:x="http://wiki.ros.org/xacro"'),
            20,
            "<x:wheel>",
        ),
        (robot_urdf(more="<mujoco><compiler angle='${unit}'/></mujoco>"), 20, 'angle="${unit}"'),
    ],
)
def test_an_unexpanded_xacro_is_told_with_the_command(make_urdf: MakeUrdf, text: str, line: int, told: str) -> None:
    with pytest.raises(LaunchError) as error:
        make_urdf(text)
    assert f"r.urdf:{line}: it is xacro that has not been expanded (" in str(error.value)
    assert told in str(error.value)
    assert "`xacro r.urdf -o r.expanded.urdf`" in str(error.value)


def test_the_command_has_the_arguments_and_a_name_without_xacro(tmp_path: Path) -> None:
    mapping = MAPPING | {"model": "r.urdf.xacro"}
    application = write_robot(tmp_path, mapping)
    text = robot_urdf(more='<xacro:arg name="prefix" default=""/>')
    (tmp_path / "my_cart" / "r.urdf.xacro").write_text(text)
    with pytest.raises(LaunchError, match=r"`xacro r\.urdf\.xacro -o r\.urdf prefix:=…`"):
        find_robot(application, {})


def test_what_xacro_leaves_behind_does_no_harm(make_urdf: MakeUrdf) -> None:
    """Expanded files keep the namespace, and plugins of Gazebo may have expressions of their own."""
    text = robot_urdf(more='<gazebo><plugin name="p"><parameters>$(find my_cart)/x.yaml</parameters></plugin></gazebo>')
    make_urdf(text.replace("<robot", '<robot xmlns:xacro="http://ros.org/wiki/xacro"'))


# Meshes


@pytest.mark.parametrize("name", ["flat.stl", "triangle.stl", "line.stl", "empty.stl"])
def test_a_mesh_without_volume_is_drawn_or_left_out_with_a_warning(
    make_urdf: MakeUrdf, meshes: Path, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    robot = make_urdf(robot_urdf(drawn(f"package://my_cart/meshes/{name}")))
    assert robot.build().compile().nmesh == (1 if name == "flat.stl" else 0)
    told = [each.getMessage() for each in caplog.records if "is not shown" in each.getMessage()]
    assert len(told) == (0 if name == "flat.stl" else 1), told
    assert all(f"r.urdf:8: package://my_cart/meshes/{name} is not shown: " in each for each in told)
    stand = Stand(robot)
    stand.drive((0.3, 0.0), 1.0)
    assert stand.base.read().linear == pytest.approx(0.3, rel=0.1)


@pytest.mark.parametrize("name", ["flat.stl", "triangle.stl", "line.stl", "empty.stl"])
def test_a_mesh_without_volume_that_collides_is_refused(make_urdf: MakeUrdf, meshes: Path, name: str) -> None:
    mesh = f"meshes/{name}"
    with pytest.raises(LaunchError, match=rf"r\.urdf:8: the mesh '{mesh}' of link 'base_link': .*use <box>"):
        make_urdf(robot_urdf(drawn(mesh) + solid(mesh)))


def test_meshes_of_the_same_name_in_two_folders_are_two(make_urdf: MakeUrdf, meshes: Path) -> None:
    """MuJoCo's importer knows a mesh by its name: the robot would collide with what is drawn."""
    scaled = ' scale="0.5 0.5 0.5"'
    shapes = drawn("meshes/visual/base.stl") + solid("meshes/collision/base.stl")
    robot = make_urdf(robot_urdf(shapes + drawn("meshes/visual/base.stl", scaled) + drawn("meshes/visual/a b.v2.stl")))
    model = robot.build().compile()
    meshes_of_geoms = np.flatnonzero(model.geom_dataid >= 0)
    # Half of the diagonals of the boxes, in metres.
    reaches = {(bool(model.geom_contype[geom]), round(float(model.geom_rbound[geom]), 3)) for geom in meshes_of_geoms}
    assert reaches == {(False, 0.144), (True, 0.075), (False, 0.072)}


@pytest.mark.parametrize("shape", [drawn, solid])
@pytest.mark.parametrize(("scale", "right"), [("", "0.001 0.001 0.001"), (' scale="1 1 -1"', "0.001 0.001 -0.001")])
def test_a_mesh_in_millimetres_is_refused_with_its_scale(
    make_urdf: MakeUrdf, meshes: Path, shape: Callable[..., str], scale: str, right: str
) -> None:
    with pytest.raises(LaunchError) as error:
        make_urdf(robot_urdf(shape("meshes/mm.stl", scale)))
    assert "r.urdf:8: the mesh 'meshes/mm.stl' reaches 170 m" in str(error.value)
    assert f'scale="{right}" is meant' in str(error.value)
    make_urdf(robot_urdf(shape("meshes/mm.stl", f' scale="{right}"')))


def test_a_shape_in_another_unit_is_refused_whichever_way(make_urdf: MakeUrdf) -> None:
    box = '<collision><geometry><box size="240 240 50"/></geometry></collision>'
    with pytest.raises(LaunchError, match=r"robot\.yaml:\d+:\d+: footprint\.radius_m: a shape of 'base_link' reaches"):
        make_urdf(robot_urdf(box))
    with pytest.raises(LaunchError, match=r"footprint\.radius_m: what collides of the robot reaches 0\.1\d* m"):
        make_urdf(robot_urdf(), footprint={"radius_m": 100})


@pytest.mark.parametrize(
    ("written", "right"),
    [
        ("package://my_cart/meshes/visual/Base.STL", "package://my_cart/meshes/visual/base.stl"),
        ("package://My_Cart/Meshes/visual/base.stl", "package://my_cart/meshes/visual/base.stl"),
        ("package://description/meshes/visual/BASE.stl", "package://description/meshes/visual/base.stl"),
        ("package://my_cart/meshes/visual/a%20b.v2.stl", "package://my_cart/meshes/visual/a b.v2.stl"),
        ("model://my_cart/meshes/visual/base.stl", "package://my_cart/meshes/visual/base.stl"),
        ("file://meshes/visual/Base.stl", "meshes/visual/base.stl"),
        ("meshes\\visual\\base.stl", "meshes/visual/base.stl"),
        ("meshes/visual/bas.stl", "meshes/visual/base.stl"),
    ],
)
def test_a_file_that_is_named_nearly_right_is_suggested(
    make_urdf: MakeUrdf, meshes: Path, written: str, right: str
) -> None:
    with pytest.raises(LaunchError) as error:
        make_urdf(robot_urdf(solid(written)))
    assert f"r.urdf:8: there is no file {written!r}; did you mean {right!r}?" in str(error.value)
    make_urdf(robot_urdf(solid(right)))


def test_no_file_outside_of_the_robots_folder_is_suggested(make_urdf: MakeUrdf, tmp_path: Path) -> None:
    (tmp_path.parent / "secret.stl").write_text("")
    with pytest.raises(LaunchError) as error:
        make_urdf(robot_urdf(solid("..%2F..%2FSecret.stl")))
    assert "secret.stl" not in str(error.value)


def test_models_and_meshes_of_mjcf_are_suggested_likewise(tmp_path: Path, meshes: Path) -> None:
    application = write_robot(tmp_path, MAPPING | {"model": "Cart.xml"})
    with pytest.raises(LaunchError, match=r"there is no such file; did you mean 'cart\.xml'\?"):
        find_robot(application, {})
    text = """<mujoco><asset><mesh name="m" file="meshes/visual/Base.STL"/></asset><worldbody><body name="base_link">
    <geom type="mesh" mesh="m"/></body></worldbody></mujoco>"""
    mapping = {key: MAPPING[key] for key in ("version", "base", "footprint", "spawn")} | {
        "drive": {"kind": "actuators"}
    }
    application = write_robot(tmp_path, mapping | {"model": "m.xml"}, m_xml=text)
    with pytest.raises(LaunchError, match=r"no file 'meshes/visual/Base.STL', did you mean 'meshes/visual/base.stl'"):
        find_robot(application, {})


# Inertia

IMPOSSIBLE = [
    (inertial(0.5, 0.002, 0, 0), "principal moments 0, 0, 0.002 kg·m², and each has to be above 0"),
    (inertial(0.5, 0.1, -0.1, 0.1), "principal moments -0.1, 0.1, 0.1 kg·m², and each has to be above 0"),
    (inertial(0.5, 0.1, 0.1, 0.3), "no body has one that is larger than the other two together"),
    (inertial(-0.5, 0.1, 0.1, 0.1), "its mass is -0.5 kg, which no body has"),
    (inertial("nan", 0.1, 0.1, 0.1), "its mass is nan kg, which no body has"),
]
MASSLESS = [
    (inertial(0.5, 0, 0, 0), "it has a mass of 0.5 kg without inertia, and moves on joint 'j'"),
    (inertial(0, 0, 0, 0), "it has a mass of 0 kg without inertia, and moves on joint 'j'"),
    (inertial(0, 0.1, 0.1, 0.1), "it has a mass of 0 kg without inertia, and moves on joint 'j'"),
]
BOX = '<{0}><origin xyz="0 0 0.1"/><geometry><box size="0.1 0.2 0.3"/></geometry></{0}>'


def arm(said: str, kind: str = "continuous") -> str:
    """A link in line 20."""
    joint = f'<joint name="j" type="{kind}"><parent link="base_link"/><child link="arm"/><axis xyz="0 0 1"/></joint>'
    return f'<link name="arm">{said}</link>\n{joint}'


@pytest.mark.parametrize(
    ("said", "told", "kind", "shape"),
    [
        *((*each, "continuous", BOX.format("collision")) for each in IMPOSSIBLE),
        *((*each, "fixed", "") for each in IMPOSSIBLE),
        *((*each, "prismatic", BOX.format("visual")) for each in MASSLESS),
        (*MASSLESS[0], "continuous", ""),
    ],
)
def test_an_impossible_inertia_is_told_with_values_and_what_to_write(
    make_urdf: MakeUrdf, said: str, told: str, kind: str, shape: str
) -> None:
    with pytest.raises(LaunchError) as error:
        make_urdf(robot_urdf(more=arm(said + shape, kind)))
    text = str(error.value)
    assert "r.urdf:20: link 'arm': " in text
    assert told in text
    suggested = text[text.index("<inertial>") : text.index("</inertial>") + len("</inertial>")]
    model = make_urdf(robot_urdf(more=arm(suggested + shape, kind))).build().compile()
    mass_kg = 0.5 if 'value="0.5"' in said else 6.0 if shape else 0.52  # kg: a box of 6 l, a ball of 0.52 l
    assert model.body("arm").mass[0] == pytest.approx(mass_kg, rel=0.01)


@pytest.mark.parametrize(
    ("said", "shape"),
    [
        *((each[0], BOX.format("collision")) for each in IMPOSSIBLE + MASSLESS),
        *((each[0], BOX.format("visual")) for each in (IMPOSSIBLE[0], MASSLESS[1])),
    ],
)
def test_by_the_setting_it_is_that_of_the_shapes_with_a_warning(
    make_urdf: MakeUrdf, said: str, shape: str, caplog: pytest.LogCaptureFixture
) -> None:
    robot = make_urdf(robot_urdf(more=arm(said + shape)), impossible_inertia="from_geometry")
    body = robot.build().compile().body("arm")
    mass_kg = 0.5 if 'value="0.5"' in said else 6.0
    expected = mass_kg / 12 * np.array([0.13, 0.1, 0.05])  # of a box of 0.1 m, 0.2 m and 0.3 m
    assert body.mass[0] == pytest.approx(mass_kg)
    assert sorted(body.inertia) == pytest.approx(sorted(expected), rel=1e-4)
    assert body.ipos.tolist() == pytest.approx([0, 0, 0.1])
    told = [each.getMessage() for each in caplog.records if "link 'arm'" in each.getMessage()]
    assert len([each for each in told if "it gets <inertial>" in each]) == 1, told


def test_by_the_setting_flat_shapes_do_and_what_is_fixed_may_be_a_point(
    make_urdf: MakeUrdf, meshes: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bad = inertial(0.5, 0.1, 0.1, 0.3)
    setting = {"impossible_inertia": "from_geometry"}
    flat = make_urdf(robot_urdf(more=arm(bad + drawn("meshes/flat.stl"))), **setting).build().compile()
    assert flat.body("arm").mass[0] == pytest.approx(0.5)
    point = make_urdf(robot_urdf(more=arm(bad, "fixed")), **setting).build().compile()
    assert (point.body("arm").mass[0], *point.body("arm").inertia) == (0.5, 0, 0, 0)
    with pytest.raises(LaunchError, match=r"link 'arm': .* a ball of 0\.05 m radius has"):
        make_urdf(robot_urdf(more=arm(bad)), **setting)


@pytest.mark.parametrize("shape", [drawn, solid])
def test_by_the_setting_a_mesh_has_the_mass_of_what_it_encloses(
    make_urdf: MakeUrdf, meshes: Path, shape: Callable[..., str]
) -> None:
    """Also one that is only drawn, which else is a shell: 1000 kg a square metre of it."""
    text = robot_urdf(more=arm(inertial(-1, 0.1, 0.1, 0.1) + shape("meshes/visual/base.stl")))
    body = make_urdf(text, impossible_inertia="from_geometry").build().compile().body("arm")
    assert body.mass[0] == pytest.approx(2.0)  # 0.2 m x 0.2 m x 0.05 m
    assert sorted(body.inertia) == pytest.approx(sorted(2 / 12 * np.array([0.0425, 0.0425, 0.08])), rel=1e-4)


def test_a_keyframe_of_a_urdf_is_missing_whatever_its_inertias_are(make_urdf: MakeUrdf) -> None:
    text = robot_urdf(more=arm(inertial(-1, 0.1, 0.1, 0.1) + BOX.format("collision")))
    spawn = {"height_m": 0.06, "keyframe": "home"}
    with pytest.raises(LaunchError, match=r"spawn\.keyframe: r\.urdf has no 'home'"):
        make_urdf(text, impossible_inertia="from_geometry", spawn=spawn)


def test_links_that_move_together_need_one_mass(make_urdf: MakeUrdf) -> None:
    hand = '<link name="hand">{}</link><joint name="h" type="fixed"><parent link="arm"/><child link="hand"/></joint>'
    make_urdf(robot_urdf(more=arm("") + hand.format(inertial(1, 0.1, 0.1, 0.1))))
    make_urdf(robot_urdf(more=arm("", "fixed")))
    with pytest.raises(LaunchError, match=r"'hand': it has no mass, and is fixed to 'arm', which moves on joint 'j'"):
        make_urdf(robot_urdf(more=arm("") + hand.format(BOX.format("visual"))))
    with pytest.raises(LaunchError, match=r"r\.urdf:20: link 'arm': it has no mass, and moves on joint 'j'"):
        make_urdf(robot_urdf(more=arm("")))


def test_a_file_that_tells_mujoco_what_to_do_is_left_to_it(make_urdf: MakeUrdf) -> None:
    settings = '<mujoco><compiler balanceinertia="true"/></mujoco>'
    model = make_urdf(robot_urdf(more=arm(inertial(0.5, 0.1, 0.1, 0.3)) + settings)).build().compile()
    assert model.body("arm").inertia[0] == pytest.approx(0.5 / 3)


def test_mass_that_the_file_does_not_say_is_told(make_urdf: MakeUrdf, caplog: pytest.LogCaptureFixture) -> None:
    make_urdf(robot_urdf())
    told = [each.getMessage() for each in caplog.records if "has no <inertial>" in each.getMessage()]
    assert told == ["r.urdf:18: link 'caster' has no <inertial>; MuJoCo gives its <collision> 1000 kg/m³"]


def test_the_setting_is_not_for_mjcf(tmp_path: Path) -> None:
    from helpers.robot_stands import CART_MAPPING

    application = write_robot(tmp_path, CART_MAPPING | {"impossible_inertia": "from_geometry"})
    with pytest.raises(LaunchError, match=r"impossible_inertia: it is for URDF"):
        find_robot(application, {})


def test_the_logs_of_good_robots_are_empty(make_urdf: MakeUrdf, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        make_urdf(
            robot_urdf().replace('<link name="caster">', f'<link name="caster">{inertial(0.1, 1e-4, 1e-4, 1e-4)}')
        )
    assert not [each for each in caplog.records if "r.urdf" in each.getMessage()]
