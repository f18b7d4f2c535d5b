"""World files: poses, frames, saved states, includes; and files that are broken or hostile."""

from pathlib import Path

import numpy as np
import pytest
from helpers.gazebo_house import model, write_house

from prefect_robomaker.tasks.sdf.reader import read_world
from prefect_robomaker.tasks.sdf.sdf_types import Pose, SdfError, SdfWorld, euler_matrix

BOX = "<geometry><box><size>1 1 1</size></box></geometry>"


def read(folder: Path, body: str, version: str = "1.7") -> SdfWorld:
    path = folder / "some.world"
    path.write_text(f'<sdf version="{version}"><world name="w">{body}</world></sdf>')
    return read_world(path, [], {"HOME": str(folder)})


def places(world: SdfWorld) -> dict[str, list[float]]:
    """Positions and yaws of links, by their paths."""
    return {
        link.path: [
            *np.round(link.pose.position, 4).tolist(),
            round(float(np.arctan2(link.pose.rotation[1, 0], link.pose.rotation[0, 0])), 4),
        ]
        for link in world.links
    }


def test_frames_are_relative_to_what_the_file_says(tmp_path: Path) -> None:
    world = read(
        tmp_path,
        """<frame name="corner"><pose>10 0 0 0 0 1.5707963</pose></frame>
        <model name="m" placement_frame="foot"><pose relative_to="corner">1 0 0 0 0 0</pose>
        <frame name="foot" attached_to="b"><pose>0 0 -0.5 0 0 0</pose></frame>
        <link name="a"/><link name="b"><pose relative_to="a">0 2 0 0 0 0</pose></link>
        <link name="c"><pose relative_to="inner::d" degrees="true">0 0 1 0 0 90</pose></link>
        <model name="inner"><pose>0 0 3 0 0 0</pose><link name="d"><pose>1 0 0 0 0 0</pose></link></model>
        </model>""",
    )
    turned = 1.5708
    # The foot, 0.5 m below b, is at (10, 1, 0); b is 2 m from a along y, which points west here.
    assert places(world) == {
        "m::a": [12, 1, 0.5, turned],
        "m::b": [10, 1, 0.5, turned],
        "m::c": [12, 2, 4.5, pytest.approx(np.pi, abs=1e-3)],
        "m::inner::d": [12, 2, 3.5, turned],
    }


def test_includes_states_and_static_models_are_as_in_gazebo(tmp_path: Path) -> None:
    world = read_world(write_house(tmp_path / "house"), [], {"HOME": str(tmp_path)})
    at = places(world)
    # The saved state of Gazebo's window counts, not the pose in the file.
    assert at["crate::link"] == [0.8, -1.5, 0.24, 0.4]
    assert at["furnishing::table::link"] == [4.5, 1.4, 0.03, 1.5708]
    assert at["furnishing::table_2::link"] == [4.5, -1.6, 0.03, 0]
    # The include places the shelf's corner.
    assert at["shelf::link"] == [-1.8, 2.0, 0.03, 0]
    fixed = {link.path for link in world.links if link.is_static}
    assert {"furnishing::table::link", "walls::link", "shelf::link"} <= fixed
    assert {"crate::link", "sunk::link", "door::leaf"} & fixed == set()
    assert {(joint.path, joint.kind, joint.parent, joint.child) for joint in world.joints} == {
        ("door::anchor", "fixed", "world", "door::frame"),
        ("door::hinge_joint", "hinge", "door::frame", "door::leaf"),
    }
    assert world.model_types["furnishing::table_2"] == "table"
    assert [light.kind for light in world.lights] == ["directional"]


def test_inner_models_give_their_static_to_the_one_around_them_unless_it_has_its_own(tmp_path: Path) -> None:
    (tmp_path / "models" / "rock").mkdir(parents=True)
    (tmp_path / "models" / "rock" / "model.sdf").write_text(model("rock", '<link name="l"/>'))
    include = "<include><uri>model://rock</uri></include>"
    world = read(
        tmp_path, f'<model name="one">{include}</model><model name="two"><static>false</static>{include}</model>'
    )
    assert {link.path: link.is_static for link in world.links} == {"one::rock::l": True, "two::rock::l": False}


SAVED_DOOR = """<model name="m"><pose>5 0 0 0 0 1.5707963</pose><link name="frame"/>
<link name="leaf"><pose>1 0 0 0 0 0</pose></link>
<joint name="hinge" type="revolute"><parent>frame</parent><child>leaf</child><pose>-0.5 0 0 0 0 0</pose>
<axis><xyz>0 0 1</xyz><limit><lower>0</lower><upper>1.5</upper></limit></axis></joint>
<link name="drawer"/><joint name="slide" type="prismatic"><parent>frame</parent><child>drawer</child>
<axis><xyz>1 0 0</xyz></axis></joint></model>
<state world_name="w"><model name="m"><pose>5 0 0 0 0 0.7</pose>
<link name="frame"><pose>5 0 0 0 0 0.7</pose></link>
<link name="leaf"><pose>{leaf}</pose></link>
<link name="drawer"><pose>{drawer}</pose></link>
<joint name="hinge"><angle axis="0">0.4</angle></joint></model></state>"""


def saved(*poses: Pose) -> list[str]:
    """Poses as Gazebo's window writes them."""
    return [
        f"{' '.join(map(str, pose.position))} 0 0 {np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])}"
        for pose in poses
    ]


def test_a_joint_is_where_its_links_are_saved(tmp_path: Path) -> None:
    """Gazebo goes by the saved poses of links: the door stands open by 0.4, and the drawer by 0.25 m."""
    model_pose = Pose(np.array([5.0, 0, 0]), euler_matrix(0, 0, 0.7))
    open_leaf = (
        model_pose @ Pose(np.array([0.5, 0, 0]), euler_matrix(0, 0, 0.4)) @ Pose(np.array([0.5, 0, 0]), np.eye(3))
    )
    drawer = model_pose @ Pose(np.array([0.25, 0, 0]), np.eye(3))
    said_leaf, said_drawer = saved(open_leaf, drawer)
    world = read(tmp_path, SAVED_DOOR.format(leaf=said_leaf, drawer=said_drawer))
    hinge, slide = world.joints
    assert hinge.position == pytest.approx(0.4)
    assert hinge.pose.position.tolist() == pytest.approx(
        (model_pose.position + 0.5 * model_pose.rotation[:, 0]).tolist()
    )
    assert (hinge.lower, hinge.upper) == (0.0, 1.5)
    assert slide.position == pytest.approx(0.25)
    assert slide.axis.tolist() == pytest.approx(model_pose.rotation[:, 0].tolist())
    assert "saved angles of joints whose links have no saved pose" not in world.left_out


def test_a_saved_angle_without_a_pose_moves_nothing_as_in_gazebo_and_is_listed(tmp_path: Path) -> None:
    text = SAVED_DOOR.replace('<link name="leaf"><pose>{leaf}</pose></link>', "").format(
        leaf="", drawer="5 0 0 0 0 0.7"
    )
    world = read(tmp_path, text)
    assert world.joints[0].position == 0.0
    assert world.left_out.names("saved angles of joints whose links have no saved pose") == ["m::hinge"]


def test_what_is_missing_is_listed_with_the_nearest_names(tmp_path: Path) -> None:
    world = read_world(
        write_house(tmp_path / "house", "<include><uri>model://shelff</uri></include>"), [], {"HOME": str(tmp_path)}
    )
    [missing] = world.left_out.names("models that are missing")
    assert missing.startswith("model://shelff (house.world:")
    assert missing.endswith("; there is shelf)")


def test_names_of_meshes_have_to_be_right_to_the_letter(tmp_path: Path) -> None:
    (tmp_path / "Rock.stl").write_text("solid")
    mesh = "<geometry><mesh><uri>rock.stl</uri></mesh></geometry>"
    world = read(tmp_path, f'<model name="m"><link name="l"><collision name="c">{mesh}</collision></link></model>')
    assert world.left_out.names("collision meshes that are missing") == ["rock.stl (m::l::c)"]


def test_a_world_reads_no_file_outside_of_its_models(tmp_path: Path) -> None:
    home = tmp_path / "a" / "b" / "c"
    home.mkdir(parents=True)
    (tmp_path / "secret.stl").write_text("solid")
    for uri in (f"file://{tmp_path}/secret.stl", "../../../secret.stl", f"{tmp_path}/secret.stl"):
        mesh = f"<geometry><mesh><uri>{uri}</uri></mesh></geometry>"
        world = read(home, f'<model name="m"><link name="l"><collision name="c">{mesh}</collision></link></model>')
        assert "collision meshes that are missing" in world.left_out


def test_models_in_a_fuel_cache_are_found_in_their_newest_version(tmp_path: Path) -> None:
    for version, name in (("2", "old"), ("10", "new")):
        folder = tmp_path / ".gz" / "fuel" / "fuel.gazebosim.org" / "someone" / "models" / "big rock" / version
        folder.mkdir(parents=True)
        (folder / "model.sdf").write_text(model(name, '<link name="l"/>'))
    uri = "https://fuel.gazebosim.org/1.0/Someone/models/Big%20Rock"
    world = read(tmp_path, f"<include><uri>{uri}</uri></include>")
    assert [link.path for link in world.links] == ["new::l"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("<sdf version='1.6'>\n<world></sdf>", "some.world:2: it is not well-formed XML: mismatched tag"),
        ("<sdf version='1.6'/>", "it has no <world>"),
        ("<sdf version='2.0'><world name='w'/></sdf>", "SDF 2.0; versions 1.3 to 1.12 can be read"),
        (
            '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>\n<sdf version="1.6"><world name="&b;"/></sdf>',
            "some.world:1: it declares a DOCTYPE",
        ),
        (
            "<sdf version='1.6'><world name='w'>\n<model name='m'><pose>0 0 6.0000006.000000 0 0 0</pose>"
            "<link name='l'/></model></world></sdf>",
            "some.world:2: <pose> is '0 0 6.0000006.000000 0 0 0'; 6 finite numbers would be right",
        ),
        (
            "<sdf version='1.6'><world name='w'><model name='m'><link name='l'><pose>nan 0 0 0 0 0</pose></link>"
            "</model></world></sdf>",
            "<pose> is 'nan 0 0 0 0 0'",
        ),
        (
            "<sdf version='1.8'><world name='w'><model name='m'><link name='a'><pose relative_to='b'/></link>"
            "<link name='b'><pose relative_to='a'/></link></model></world></sdf>",
            "is relative to itself",
        ),
        (
            "<sdf version='1.8'><world name='w'><model name='m'><link name='a'><pose relative_to='z'/></link></model>"
            "</world></sdf>",
            "there is no frame 'z' in it; it has a",
        ),
        ("<a>" * 300 + "</a>" * 300, "nested deeper than 200"),
    ],
)
def test_what_is_no_world_gets_one_error_with_its_place(tmp_path: Path, content: str, said: str) -> None:
    path = tmp_path / "some.world"
    path.write_text(content)
    with pytest.raises(SdfError) as caught:
        read_world(path, [], {})
    assert said in str(caught.value)


def test_a_model_that_includes_itself_ends(tmp_path: Path) -> None:
    (tmp_path / "models" / "loop").mkdir(parents=True)
    (tmp_path / "models" / "loop" / "model.sdf").write_text(model("loop", "<include><uri>model://loop</uri></include>"))
    with pytest.raises(SdfError, match="include themselves"):
        read(tmp_path, "<include><uri>model://loop</uri></include>")


def test_a_declaration_after_a_comment_is_tolerated_and_lines_stay_right(tmp_path: Path) -> None:
    path = tmp_path / "some.world"
    path.write_text("<!-- a\nb -->\n<?xml version='1.0'?>\n<sdf version='1.6'><world name='w'>\n<bad</world></sdf>")
    with pytest.raises(SdfError, match=r"some\.world:5: it is not well-formed"):
        read_world(path, [], {})
