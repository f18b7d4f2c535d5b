import logging
from pathlib import Path

import pytest
import trimesh

from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.robots.robot_yaml.model import load_model

URDF = """<robot name="box"><link name="base"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><mesh filename="{visual}"/></geometry></visual>
<collision><geometry><mesh filename="{collision}"/></geometry></collision></link>
<link name="plate"/><joint name="fixed" type="fixed"><parent link="base"/><child link="plate"/></joint></robot>"""
MJCF = '<mujoco>{compiler}<asset><mesh name="m" file="{file}"/></asset>{more}<worldbody/></mujoco>'


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    folder = tmp_path / "bundle"
    (folder / "my_box" / "urdf").mkdir(parents=True)
    (folder / "my_box" / "meshes").mkdir()
    trimesh.creation.box((0.2, 0.1, 0.05)).export(folder / "my_box" / "meshes" / "box.stl")
    trimesh.creation.box((0.2, 0.1, 0.05)).export(tmp_path / "outside.stl")
    return folder


def urdf(bundle: Path, visual: str, collision: str) -> Path:
    path = bundle / "my_box" / "urdf" / "box.urdf"
    path.write_text(URDF.format(visual=visual, collision=collision))
    return path


@pytest.mark.parametrize(
    "name", ["package://my_box/meshes/box.stl", "package://box_description/meshes/box.stl", "../meshes/box.stl"]
)
def test_meshes_of_a_urdf_are_found_by_package_and_by_place(
    bundle: Path, name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    spec = load_model(urdf(bundle, name, name), bundle)
    monkeypatch.chdir(tmp_path)
    model = spec.compile()
    assert (model.nmesh, model.ngeom) == (1, 2)
    # Links on fixed joints keep their names, and what is only seen is there.
    assert {model.body(index).name for index in range(model.nbody)} == {"world", "base", "plate"}
    assert sorted(model.geom_contype.tolist()) == [0, 1]


def test_a_mesh_for_the_eye_that_mujoco_cannot_read_is_left_out_and_told(
    bundle: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        spec = load_model(urdf(bundle, "package://my_box/meshes/box.dae", "package://my_box/meshes/box.stl"), bundle)
    assert spec.compile().ngeom == 1
    assert "box.dae is not shown" in caplog.text


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("package://my_box/meshes/box.dae", "cannot be read; MuJoCo reads .stl, .obj and .msh"),
        ("package://my_box/meshes/none.stl", "there is no file 'package://my_box/meshes/none.stl'; looked for "),
        ("package://../../outside.stl", "is outside of"),
        ("../../../outside.stl", "is outside of"),
        ("/etc/box.stl", "is absolute; write package://"),
        ("file:///etc/box.stl", "is absolute; write package://"),
    ],
)
def test_a_mesh_that_is_not_in_the_bundle_is_refused(bundle: Path, name: str, message: str) -> None:
    with pytest.raises(LaunchError, match=message) as error:
        load_model(urdf(bundle, "package://my_box/meshes/box.stl", name), bundle)
    assert error.value.failure_code == "InvalidBundleRobotApplication"
    assert "box.urdf" in str(error.value)


def mjcf(bundle: Path, file: str, compiler: str = "", more: str = "") -> Path:
    path = bundle / "my_box" / "box.xml"
    path.write_text(MJCF.format(file=file, compiler=compiler, more=more))
    return path


def test_an_mjcf_finds_its_files_and_what_it_includes(bundle: Path) -> None:
    (bundle / "my_box" / "arm.xml").write_text("<mujoco><asset><mesh name='n' file='box.stl'/></asset></mujoco>")
    path = mjcf(bundle, "box.stl", '<compiler meshdir="meshes"/>', '<include file="arm.xml"/>')
    assert len(load_model(path, bundle).meshes) == 2


@pytest.mark.parametrize(
    ("file", "compiler", "more"),
    [
        ("../../outside.stl", "", ""),
        ("outside.stl", '<compiler meshdir="../.."/>', ""),
        ("outside.stl", '<compiler assetdir="../.."/>', ""),
        ("meshes/box.stl", "", '<include file="../../other.xml"/>'),
        ("meshes/box.stl", "", '<include file="inner.xml"/>'),
        ("link.stl", "", ""),
        ("/etc/passwd", "", ""),
    ],
)
def test_an_mjcf_that_names_files_outside_is_refused(bundle: Path, file: str, compiler: str, more: str) -> None:
    (bundle / "my_box" / "inner.xml").write_text("<mujoco><asset><mesh file='../../outside.stl'/></asset></mujoco>")
    (bundle / "my_box" / "link.stl").symlink_to(bundle.parent / "outside.stl")
    with pytest.raises(LaunchError, match=r"is outside of|is absolute"):
        load_model(mjcf(bundle, file, compiler, more), bundle)


def test_an_mjcf_that_includes_itself_is_refused(bundle: Path) -> None:
    (bundle / "my_box" / "inner.xml").write_text('<mujoco><include file="inner.xml"/></mujoco>')
    with pytest.raises(LaunchError, match=r"inner\.xml: the file 'inner.xml' includes itself"):
        load_model(mjcf(bundle, "meshes/box.stl", "", '<include file="inner.xml"/>'), bundle)


@pytest.mark.parametrize(("text", "message"), [("no xml", "it is no XML"), ("<mujoco><nonsense/></mujoco>", "MuJoCo")])
def test_what_is_no_model_is_named(bundle: Path, text: str, message: str) -> None:
    (bundle / "bad.xml").write_text(text)
    with pytest.raises(LaunchError, match=rf"bad\.xml: .*{message}"):
        load_model(bundle / "bad.xml", bundle)
    with pytest.raises(LaunchError, match="there is no such file"):
        load_model(bundle / "none.xml", bundle)
