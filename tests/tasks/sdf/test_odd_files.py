"""Joints, merges, meshes and materials as public files have them, and files that mean harm."""

import os
from pathlib import Path

import numpy as np
import pytest
from helpers.gazebo_house import dae, model, triangles_of

from prefect_robomaker.tasks.sdf.lookup import Lookup
from prefect_robomaker.tasks.sdf.meshes import MeshError, Meshes
from prefect_robomaker.tasks.sdf.reader import read_world
from prefect_robomaker.tasks.sdf.sdf_types import Geometry, SdfWorld

BOX = "<geometry><box><size>1 1 1</size></box></geometry>"
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def read(folder: Path, body: str, version: str = "1.7") -> SdfWorld:
    path = folder / "some.world"
    path.write_text(f'<sdf version="{version}"><world name="w">{body}</world></sdf>')
    return read_world(path, [], {"HOME": str(folder)})


def write_model(folder: Path, name: str, text: str) -> str:
    """Writes a model beside the world; returns the element that includes it."""
    (folder / "models" / name).mkdir(parents=True)
    (folder / "models" / name / "model.sdf").write_text(text)
    return f"<include><uri>model://{name}</uri></include>"


def hinge(lower: str, upper: str) -> str:
    return (
        '<model name="m"><link name="leaf"/><joint name="leaf" type="revolute"><parent>world</parent>'
        f"<child>leaf</child><axis><xyz>0 0 1</xyz><limit><lower>{lower}</lower><upper>{upper}</upper></limit></axis>"
        "</joint></model>"
    )


@pytest.mark.parametrize(("lower", "upper"), [("-1e16", "1e16"), ("-inf", "inf"), ("-1.79769e+308", "1.79769e+308")])
def test_limits_without_an_end_are_none(tmp_path: Path, lower: str, upper: str) -> None:
    """Gazebo itself writes these; the joint of an older file may also be called like its link."""
    [joint] = read(tmp_path, hinge(lower, upper), "1.6").joints
    assert (joint.kind, joint.lower, joint.upper) == ("hinge", None, None)


def test_endless_friction_is_the_most_that_there_is(tmp_path: Path) -> None:
    surface = "<surface><friction><ode><mu>inf</mu><mu2>1e30</mu2></ode></friction></surface>"
    [link] = read(
        tmp_path, f'<model name="m"><link name="l"><collision name="c">{BOX}{surface}</collision></link></model>'
    ).links
    assert link.collisions[0].friction == 1.0


@pytest.mark.parametrize(("version", "along"), [("1.4", [0, 0, 1]), ("1.6", [0, -1, 0])])
def test_an_axis_is_read_by_the_version_of_the_file_that_it_is_in(
    tmp_path: Path, version: str, along: list[float]
) -> None:
    """Before SDF 1.5 it was in the model's frame; since, in the joint's, which lies on its side here."""
    text = model(
        "wheel",
        '<link name="l"><pose>0 0 0 1.5707963 0 0</pose></link><joint name="j" type="revolute">'
        "<parent>world</parent><child>l</child><axis><xyz>0 0 1</xyz></axis></joint>",
        version=version,
        static="",
    )
    [joint] = read(tmp_path, write_model(tmp_path, "wheel", text), "1.7").joints
    assert np.round(joint.axis, 3).tolist() == along


def test_merged_models_hand_their_frames_and_joints_to_the_model_around(tmp_path: Path) -> None:
    base = '<link name="base"><pose>0 0 1 0 0 0</pose></link><frame name="top" attached_to="base"><pose>0 0 2 0 0 0</pose></frame>'  # noqa: E501
    inner = write_model(tmp_path, "inner", model("inner", base, version="1.9", static=""))
    middle = write_model(
        tmp_path, "middle", model("middle", inner.replace("<include>", '<include merge="true">'), version="1.9")
    )
    merged = middle.replace("<include>", '<include merge="true">').replace(
        "</include>", "<pose>5 0 0 0 0 0</pose></include>"
    )
    arm = '<link name="arm"><pose relative_to="top"/></link><joint name="j" type="ball"><parent>base</parent><child>arm</child></joint>'  # noqa: E501
    world = read(tmp_path, f'<model name="robot"><static>false</static>{merged}{arm}</model>', "1.9")
    assert {link.path: link.pose.position.tolist() for link in world.links} == {
        "robot::base": [5, 0, 1],
        "robot::arm": [5, 0, 3],
    }
    [joint] = world.joints
    assert (joint.kind, joint.parent, joint.child) == ("ball", "robot::base", "robot::arm")


def test_odd_colours_addresses_and_versions_are_no_crash(tmp_path: Path) -> None:
    material = "<material><diffuse>0.5.5 . 1 nan 1</diffuse></material>"
    world = read(
        tmp_path,
        f'<model name="m"><link name="l"><visual name="v">{BOX}{material}</visual></link></model>'
        "<include><uri>http://[x/a/models/b</uri></include>"
        '<light name="s" type="point"><diffuse>nan 1 0</diffuse></light>',
    )
    assert "models that are missing" in world.left_out
    assert all(0 <= share <= 1 for share in (*world.links[0].visuals[0].material.color, *world.lights[0].diffuse))


def test_the_folder_of_models_may_be_the_one_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    include = write_model(tmp_path, "rock", model("rock", '<link name="l"/>'))
    path = tmp_path / "far" / "off" / "from" / "here" / "some.world"
    path.parent.mkdir(parents=True)
    path.write_text(f'<sdf version="1.7"><world name="w">{include}</world></sdf>')
    monkeypatch.chdir(tmp_path / "models")
    assert [link.path for link in read_world(path, [Path()], {"HOME": str(tmp_path)}).links] == ["rock::l"]


@pytest.mark.parametrize("uri", ["../../secret.obj", "linked.obj"])
def test_two_folders_up_nothing_is_read(tmp_path: Path, uri: str) -> None:
    """A world in a folder of downloads must not read what else is in a home."""
    home = tmp_path / "downloads" / "house"
    home.mkdir(parents=True)
    (tmp_path / "secret.obj").write_text(TETRAHEDRON)
    (home / "linked.obj").symlink_to(tmp_path / "secret.obj")
    mesh = f"<geometry><mesh><uri>{uri}</uri></mesh></geometry>"
    world = read(home, f'<model name="m"><link name="l"><collision name="c">{mesh}</collision></link></model>')
    assert "collision meshes that are missing" in world.left_out


def meshes_of(path: Path) -> Meshes:
    return Meshes(Lookup(path.parent / "some.world", [], {"HOME": str(path.parent)}))


def test_gltf_keeps_its_axes_as_in_gazebo(tmp_path: Path) -> None:
    import trimesh

    path = tmp_path / "box.glb"
    trimesh.creation.box((1.0, 2.0, 3.0)).export(str(path))
    corners = meshes_of(path).triangles(Geometry("mesh", file=path)).reshape(-1, 3)
    assert np.ptp(corners, axis=0).tolist() == pytest.approx([1, 2, 3])


def test_a_mesh_names_no_pipe_and_nothing_outside_of_its_folder(tmp_path: Path) -> None:
    """A pipe would hold the import up for ever."""
    folder = tmp_path / "meshes"
    folder.mkdir()
    os.mkfifo(folder / "pipe.mtl")
    (tmp_path / "secret.mtl").write_text("newmtl red\nKd 1 0 0\n")
    for name in ("pipe.mtl", "../secret.mtl"):
        path = folder / "rock.obj"
        path.write_text(f"mtllib {name}\nusemtl red\n{TETRAHEDRON}")
        try:
            parts = meshes_of(path).parts(Geometry("mesh", file=path))
        except MeshError:
            continue
        assert [part.material.color for part in parts] != [(1.0, 0.0, 0.0, 1.0)]


def test_a_mesh_larger_than_a_world_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rock.obj"
    path.write_text(TETRAHEDRON)
    with pytest.raises(MeshError, match=r"in its scale it reaches 3e\+09 m"):
        meshes_of(path).parts(Geometry("mesh", file=path, scale=(1e9, 1e9, 1e9)))


def test_a_header_with_a_thousand_million_faces_is_no_mesh(tmp_path: Path) -> None:
    path = tmp_path / "rock.stl"
    path.write_bytes(b"\0" * 80 + (10**9).to_bytes(4, "little") + b"\0" * 50)
    with pytest.raises(MeshError, match=r"rock\.stl: it has no triangles"):
        meshes_of(path).parts(Geometry("mesh", file=path))


def submesh_in(folder: Path, name: str, text: str, submesh: str, is_centred: bool = False) -> np.ndarray:
    """Corners of a submesh of a file, lowest and highest."""
    path = folder / name
    path.write_text(text)
    meshes = Meshes(Lookup(folder / "some.world", [], {"HOME": str(folder)}))
    found = meshes.triangles(Geometry("mesh", file=path, submesh=submesh, is_centred=is_centred)).reshape(-1, 3)
    return np.round(np.array([found.min(axis=0), found.max(axis=0)]), 6)


PAIR = f"o near\n{TETRAHEDRON}o far\n" + "v 9 0 0\nv 10 0 0\nv 9 2 0\nv 9 0 3\nf 5 7 6\nf 5 6 8\nf 5 8 7\nf 6 7 8\n"


def test_a_submesh_of_an_obj_file_is_the_object_or_group_of_that_name(tmp_path: Path) -> None:
    groups = PAIR.replace("o near", "g near").replace("o far", "g far")
    assert submesh_in(tmp_path, "groups.obj", groups, "far").tolist() == [[9, 0, 0], [10, 2, 3]]
    assert submesh_in(tmp_path, "pair.obj", PAIR, "far").tolist() == [[9, 0, 0], [10, 2, 3]]
    assert submesh_in(tmp_path, "pair.obj", PAIR, "far", is_centred=True).tolist() == [[-0.5, -1, -1.5], [0.5, 1, 1.5]]
    with pytest.raises(MeshError, match=r"pair\.obj: it has no submesh 'fur'; it has .*far"):
        submesh_in(tmp_path, "pair.obj", PAIR, "fur")


def test_a_submesh_of_a_dae_file_is_the_node_of_that_name(tmp_path: Path) -> None:
    """Gazebo calls submeshes by the nearest node with a name; geometries are called otherwise here."""
    text = dae(triangles_of((0, 0, 0, 1, 1, 1)))
    placed = text.replace('<node id="n">', '<node name="lid"><translate>0 0 5</translate><node id="n">', 1)
    twice = text[text.index('<node id="n">') : text.index("</visual_scene>")]
    other = twice.replace('id="n"', 'id="o" name="box"')
    both = placed.replace("</visual_scene>", f"</node>{other}</visual_scene>")
    assert submesh_in(tmp_path, "two.dae", both, "lid").tolist() == [[0, 0, 5], [1, 1, 6]]
    assert submesh_in(tmp_path, "two.dae", both, "box").tolist() == [[0, 0, 0], [1, 1, 1]]
    with pytest.raises(MeshError, match="it has no submesh 'cup'; it has lid, box"):
        submesh_in(tmp_path, "two.dae", both, "cup")


ENDS = """<model name="m"><pose>5 0 0 0 0 0</pose><link name="post"/>
<frame name="edge" attached_to="post"><pose>0.5 0 0 0 0 0</pose></frame>
<frame name="rim" attached_to="edge"><pose>0 0 1 0 0 0</pose></frame>
<model name="leaf"><pose>1 0 0 0 0 0</pose><link name="a"/><link name="b"/>
<joint name="j" type="fixed"><parent>a</parent><child>b</child></joint></model>
<joint name="hinge" type="revolute"><parent>rim</parent><child>{child}</child><axis><xyz>0 0 1</xyz></axis></joint>
</model>"""


@pytest.mark.parametrize(
    ("child", "link"), [("leaf", "a"), ("leaf::__model__", "a"), ("leaf::b", "b"), ("leaf::j", "b")]
)
def test_a_joint_may_name_its_ends_by_frames(tmp_path: Path, child: str, link: str) -> None:
    """They were joints without their links, and doors fell out of their frames."""
    world = read(tmp_path, ENDS.format(child=child), "1.9")
    [joint] = [each for each in world.joints if each.kind == "hinge"]
    assert (joint.parent, joint.child) == ("m::post", f"m::leaf::{link}")
    assert joint.pose.position.tolist() == [6, 0, 0]


def test_what_a_file_takes_out_of_the_world_is_listed(tmp_path: Path) -> None:
    def collision(name: str, contact: str) -> str:
        return f'<collision name="{name}">{BOX}<surface><contact>{contact}</contact></surface></collision>'

    shapes = collision("a", "<collide_bitmask>0x00</collide_bitmask>") + collision(
        "b", "<collide_without_contact>true</collide_without_contact>"
    )
    solid = collision("c", "<collide_bitmask>0x10</collide_bitmask>") + collision("d", "<ode/>")
    world = read(tmp_path, f'<gravity>0 0 -1.62</gravity><model name="m"><link name="l">{shapes}{solid}</link></model>')
    assert [each.name for each in world.links[0].collisions] == ["m::l::c", "m::l::d"]
    assert [(left.what, left.names) for left in world.left_out.as_list()] == [
        ("collision shapes that collide with nothing, as the file says", ["m::l::a", "m::l::b"]),
        ("gravities other than that of the earth", ["0 0 -1.62"]),
    ]
    assert read(tmp_path, "<gravity>0 0 -9.80665</gravity>").left_out.as_list() == []


def test_only_the_first_model_of_a_file_is_included_and_changes_of_it_are_not_made(tmp_path: Path) -> None:
    link = '<link name="l"/>'
    include = write_model(
        tmp_path, "two", f'<sdf version="1.6"><model name="a">{link}</model><model name="b">{link}</model></sdf>'
    )
    params = '<experimental:params><link element_id="l" action="remove"/></experimental:params></include>'
    world = read(tmp_path, include.replace("</include>", params), "1.8")
    assert [each.path for each in world.links] == ["a::l"]
    assert [(left.what, left.names) for left in world.left_out.as_list()] == [
        ("changes of included models (experimental:params)", ["a"]),
        ("models after the first of a file", ["model.sdf of a: b"]),
    ]


SKIN = """<library_controllers><controller id="k"><skin source="#g">
<bind_shape_matrix>1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1</bind_shape_matrix>
<source id="j"><Name_array id="ja" count="1">bone</Name_array><technique_common><accessor source="#ja" count="1">
<param name="JOINT" type="Name"/></accessor></technique_common></source>
<source id="b"><float_array id="ba" count="16">1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</float_array><technique_common>
<accessor source="#ba" count="1" stride="16"><param name="T" type="float4x4"/></accessor></technique_common></source>
<source id="w"><float_array id="wa" count="1">1</float_array><technique_common><accessor source="#wa" count="1">
<param name="W" type="float"/></accessor></technique_common></source>
<joints><input semantic="JOINT" source="#j"/><input semantic="INV_BIND_MATRIX" source="#b"/></joints>
<vertex_weights count="36"><input semantic="JOINT" source="#j" offset="0"/>
<input semantic="WEIGHT" source="#w" offset="1"/><vcount>{counts}</vcount><v>{weights}</v></vertex_weights>
</skin></controller></library_controllers>"""


def test_a_mesh_with_bones_stands_as_it_was_bound(tmp_path: Path) -> None:
    """Beside a mesh without bones it was left out unsaid."""
    skin = SKIN.format(counts="1 " * 36, weights="0 0 " * 36)
    text = dae(triangles_of((0, 0, 0, 1, 1, 1))).replace("<library_visual_scenes>", f"{skin}<library_visual_scenes>")
    node = '<node id="q"><instance_controller url="#k"/></node></visual_scene>'
    (tmp_path / "both.dae").write_text(text.replace("</visual_scene>", node))
    meshes = Meshes(Lookup(tmp_path / "some.world", [], {"HOME": str(tmp_path)}))
    corners = meshes.triangles(Geometry("mesh", file=tmp_path / "both.dae")).reshape(-1, 3)
    assert len(corners) == 2 * 36
    assert [corners.min(axis=0).tolist(), corners.max(axis=0).tolist()] == [[0, 0, 0], [6, 1, 1]]
