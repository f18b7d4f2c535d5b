"""`robomaker world import` and `vary`: worlds of the catalog like any other."""

import json
import re
import shlex
import zipfile
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY

FLAT = REPOSITORY / "deployments" / "specs" / "plans" / "flat.svg"
ROLE = "arn:aws:iam::000000000000:role/test"


@pytest.mark.deep
def test_an_imported_flat_is_listed_described_shown_varied_exported_and_deleted(
    robomaker_at_server, home: Path, tmp_path: Path
) -> None:
    robomaker = robomaker_at_server
    made = robomaker("world", "import", FLAT, "--seed", 4)
    assert (made.code, made.err) == (0, "")
    arn, verdict = made.out.splitlines()[:2]
    assert verdict.endswith(": all guarantees hold")
    assert "door to-bath of 0.80 m between Hall and Bathroom" in made.out
    assert "behind doors not open enough: Bathroom" in made.out

    described = json.loads(robomaker("call", "DescribeWorld", "--input", json.dumps({"world": arn})).out)
    body = json.loads(described["worldDescriptionBody"])
    assert body["source"]["file"] == "flat.svg"
    assert body["proofs"]["guaranteesHold"] is True
    shown = robomaker("world", "show", arn).out
    assert "drawn     flat.svg, 1 m a unit, outlines are the faces of walls" in shown
    assert "wishes of the drawing" in shown
    assert robomaker("world", "prove", arn).code == 0
    assert robomaker("world", "view", arn, "--html", tmp_path / "view.html").code == 0

    varied = robomaker("world", "vary", arn, "--open", "Hall/Bathroom", "--name", "open flat", "-o", "json")
    facts = json.loads(varied.out)
    assert (
        robomaker("world", "show", "open flat", "-o", "json").out
        == robomaker("world", "show", facts["arn"], "-o", "json").out
    )
    assert (varied.code, facts["proven"], facts["closed_off_rooms"]) == (0, True, [])
    assert facts["variation"]["of_world"] == arn
    assert facts["variation"]["changes"] == [
        {"what": "door", "thing": "door-3", "before": "0 % open", "after": "100 % open"}
    ]
    blocked = robomaker("world", "vary", arn, "--move", "Beds_1=0,-1.2")
    assert blocked.code == 1
    assert "guarantees are broken\n    parts overlap by" in blocked.out
    assert "outside of every room" in robomaker("world", "vary", arn, "--move", "Beds_1=0,-5").err
    listed = json.loads(robomaker("call", "ListWorlds").out)["worldSummaries"]
    assert [each["arn"] for each in listed] == [blocked.out.splitlines()[0], facts["arn"], arn]

    order = {
        "worlds": [arn, facts["arn"]],
        "outputLocation": {"s3Bucket": "robomaker", "s3Prefix": "x"},
        "iamRole": ROLE,
    }
    exported = robomaker("call", "CreateWorldExportJob", "--input", json.dumps(order), "--wait")
    assert json.loads(exported.out)["status"] == "Completed", exported.err
    [archive] = home.rglob("x/*.zip")
    names = zipfile.ZipFile(archive).namelist()
    for each in (arn, facts["arn"]):
        assert any(each.rpartition("/")[2].replace("-", "_") in name for name in names)

    deleted = robomaker("call", "BatchDeleteWorlds", "--input", json.dumps({"worlds": [arn]}))
    assert json.loads(deleted.out).get("unprocessedWorlds", []) == []
    assert robomaker("world", "show", arn).code == 2
    assert robomaker("world", "show", facts["arn"]).code == 0


def test_equal_imports_share_a_bundle_that_goes_with_the_last_of_them(robomaker) -> None:
    one, other = (robomaker("world", "import", FLAT).out.splitlines()[0] for _ in range(2))
    assert one != other
    robomaker("call", "BatchDeleteWorlds", "--input", json.dumps({"worlds": [one]}))
    named = other.rpartition("world/")[2]
    assert json.loads(robomaker("world", "show", named, "-o", "json").out)["arn"] == other
    described = robomaker("call", "DescribeWorld", "--input", json.dumps({"world": other}))
    assert described.code == 0, described.err
    assert json.loads(json.loads(described.out)["worldDescriptionBody"])["source"]["file"] == "flat.svg"


def test_an_import_has_the_name_that_it_is_given(robomaker) -> None:
    refused = robomaker("world", "import", FLAT, "--name", "import-82856b0yq33y")
    assert (refused.code, refused.out) == (2, "")
    assert "--name 'import-82856b0yq33y': it would be taken for an ARN or an id" in refused.err
    arn, verdict = robomaker("world", "import", FLAT, "--name", "grandma's  flat").out.splitlines()[:2]
    assert verdict == f"grandma's flat ({arn.rpartition('/')[2]}): all guarantees hold"
    facts = json.loads(robomaker("world", "show", "grandma's flat", "-o", "json").out)
    assert (facts["arn"], facts["name"]) == (arn, "grandma's flat")
    again = robomaker("world", "import", FLAT, "--name", "grandma's flat")
    assert (again.code, again.out.splitlines()[0]) == (0, arn)
    assert again.err == f"{facts['id']} has this name and the same content already; no other world is made.\n"
    taken = robomaker("world", "import", FLAT, "--seed", 1, "--name", "grandma's flat")
    assert (taken.code, taken.out) == (2, "")
    assert f'the name "grandma\'s flat" is taken by {facts["id"]}' in taken.err
    deleted = robomaker("call", "BatchDeleteWorlds", "--input", json.dumps({"worlds": ["grandma's flat"]}))
    assert (deleted.code, deleted.err) == (0, f'"grandma\'s flat" is {arn}\n')


def test_the_example_of_the_page_is_a_world(robomaker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = (REPOSITORY / "docs" / "world-import.md").read_text()
    for language, name in (("svg", "plan.svg"), ("yaml", "plan.yaml")):
        block, *_ = re.findall(rf"^```{language}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
        (tmp_path / name).write_text(block)
    [command, other] = re.findall(r"^\$ robomaker (.*)$", page, re.MULTILINE)
    facts = json.loads(robomaker(*shlex.split(command), "-o", "json").out)
    assert (facts["proven"], facts["wishes"]["not_granted"], facts["source"]["left_out"]) == (True, [], [])
    assert facts["closed_off_rooms"] == ["Kontor"]
    office = facts["rooms"][2]
    assert (office["type"], {"Desks", "DeskChairs"} <= office["pieces"].keys()) == ("Living", True)

    [program] = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    exec(compile(program, "docs/world-import.md", "exec"), {})
    facts = json.loads(robomaker(*shlex.split(other), "-o", "json").out)
    assert (facts["proven"], facts["wishes"]["not_granted"], facts["source"]["left_out"]) == (True, [], [])
    assert [room["type"] for room in facts["rooms"]] == ["Living", "Kitchen"]


def test_notes_beside_a_drawing_are_read_and_their_mistakes_have_places(robomaker, tmp_path: Path) -> None:
    plan = tmp_path / "flat.svg"
    plan.write_text(FLAT.read_text().replace('data-type="Bedroom"', "").replace("Kinderzimmer", "Kontor"))
    refused = robomaker("world", "import", plan)
    assert (refused.code, refused.out) == (2, "")
    assert "flat.svg: room 'Kontor': what kind of room it is cannot be told from its name" in refused.err
    notes = tmp_path / "flat.yaml"
    notes.write_text("rooms:\n  Kontor: {type: Den}\n")
    refused = robomaker("world", "import", plan)
    assert (refused.code, refused.out) == (2, "")
    assert "flat.yaml:2:18" in refused.err
    notes.write_text("rooms:\n  Kontor: {type: Living}\nceilingHeight: 2.75\n")
    made = json.loads(robomaker("world", "import", plan, "-o", "json").out)
    assert made["building"]["ceiling_height_m"] == 2.75
    assert made["rooms"][-1]["type"] == "Living"
    assert len(made["source"]["notes_sha256"]) == 64


def test_worlds_of_a_workspace_are_listed_with_all_of_their_starts(robomaker, tmp_path: Path) -> None:
    ends = {"x_pos": 1, "y_pos": 2, "yaw": 0.5, "z_pos": 2.8}
    arguments = "".join(f'<arg name="{name}" default="{value}"/>' for name, value in ends.items())
    (tmp_path / "go.launch").write_text(f'<launch>{arguments}<arg name="w" value="a.world"/></launch>')
    for name in ("a", "b"):
        (tmp_path / f"{name}.world").write_text('<sdf version="1.6"><world name="w"/></sdf>')
    text, listed = robomaker("world", "import", tmp_path), robomaker("world", "import", tmp_path, "-o", "json")
    assert text.out.splitlines() == ["a  a.world  start 1,2,0.5,2.8 of go.launch", "b  b.world  no start"]
    assert [each["start"] for each in json.loads(listed.out)["worlds"]] == [[1.0, 2.0, 0.5, 2.8], None]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["import", "hose.world"], "hose.world: it does not exist; its folder has no .world file"),
        (["import", FLAT.parent / "flat.sdf"], "flat.sdf: it does not exist; in its folder there is flat.svg"),
        (["import", "nowhere/house.world"], "nowhere/house.world: it does not exist; there is no folder nowhere"),
        (["import", "bundle.tar.gz"], "bundle.tar.gz: it does not exist"),
        (["import", FLAT.parent, "--world", "x"], "plans: no file in it is a Gazebo world"),
        (["import", FLAT, "--world", "x"], "--world is for workspaces and bundles"),
        (["import", FLAT, "--start", "1,2,3,4,5"], "3.5,1.0 or 3.5,1.0,1.57 or, with a height"),
        (["import", FLAT, "--scale", "wide"], "--scale is 'wide'; metres a unit, such as 0.01"),
        (["import", FLAT, "--seed", "-1"], "--seed is -1; 0 or more would be right"),
        (["import", FLAT, "--scale", "0.01"], "say its scale with --scale"),
        (["vary", "x", "--open", "door-1=120"], "'door-1=120': a door such as door-2"),
        (["import", "map.pgm"], "a file that ends with .svg, .dxf, .yaml for a map"),
        (["vary", FLAT, "--shut", "door-1", "--open", "door-1=50"], "--shut, --open: door-1 is named 2 times"),
        (["vary", "x", "--friction", "=0.3"], "'=0.3': a number, 0.3, or a piece and one, crate=0.3"),
        (["vary", "x", "--move", "Sofas_1"], "'Sofas_1': a piece and metres to the east and north"),
    ],
)
def test_wrong_words_are_one_clear_error(robomaker, words: list[object], expected: str) -> None:
    ended = robomaker("world", *words)
    assert (ended.code, ended.out) == (2, "")
    assert expected in ended.err
