"""Specifications with one mistake each: one problem, with its place, the value and what would be right.

Every row changes one place of the quickstart specification, as a slip of a finger or of the mind would.
"""

from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import SpecError

QUICKSTART = REPOSITORY / "deployments" / "specs" / "quickstart.yaml"
SUCCEEDED = "${{ worlds.finishedWorldsSummary.succeededWorlds }}"
SEED = "seed: 1"
TAGS = f"{SEED}\n          tags: "
EXPORT = "  export:\n"

# What is written, what stands there instead, words of the message.
MISTAKES: list[tuple[str, str, tuple[str, ...]]] = [
    # Misspelt keys
    ("worldCount:", "worldCont:", ("worldCont", "not known", "'worldCount'")),
    ("seed: 7", "sead: 7", ("sead", "'seed'")),
    ("steps:", "stages:", ("stages", "'steps'")),
    ("maxJobDurationInSeconds:", "maxJobDuration:", ("maxJobDuration", "'maxJobDurationInSeconds'")),
    ("launchConfig: {}", "launchconfig: {}", ("launchconfig", "'launchConfig'")),
    ("s3Bucket: robomaker, s3Prefix: exports", "bucket: robomaker", ("bucket", "'s3Bucket'")),
    ("Height: 2.6", "Heigth: 2.6", ("Heigth", '"Height"')),
    ("Area: 14", "Aera: 14", ("Aera", '"Area"')),
    ("DesiredConnections:", "Connections:", ("Connections", '"DesiredConnections"')),
    ("forEach:", "forEech:", ("forEech", "'forEach'")),
    ("        value:\n", "        valu:\n", ("valu", "'value'")),
    (EXPORT, f"{EXPORT}    ifExist: fail\n", ("ifExist", "'ifExists'")),
    # Missing and empty values
    ("floorplanCount: 2", "floorplanCount: ~", ("floorplanCount", "have to be given", "at least 1")),
    ("version: 1\n", "\n", ("version", "missing", "required")),
    ("AspectRatio: {x: 1, y: 1}", "", ("AspectRatio", "missing")),
    ("    operation: CreateWorldExportJob\n", "", ("steps.export.operation", "missing")),
    (f"worlds: {SUCCEEDED}", "worlds: []", ("empty list", "at least 1")),
    # Wrong types
    ("floorplanCount: 2", "floorplanCount: two", ("'two'", "whole number")),
    ("floorplanCount: 2", "floorplanCount: 2.5", ("2.5", "whole number")),
    ("floorplanCount: 2", "floorplanCount: true", ("is true", "whole number")),
    ("seed: 7", 'seed: "7"', ("'7'", "whole number")),
    ("Area: 14", "Area: '14'", ('"14"', "a number without quotes")),
    ("Area: 14", "Area: .nan", (".nan", "not a number")),
    ('Version: "1"', "Version: 1", ("1:", '"1" or "2", in quotes')),
    ("launchConfig: {}", "launchConfig: []", ("empty list", "a mapping")),
    (SEED, TAGS + "{flat: 1}", ("is 1", 'in quotes: "1"')),
    (SEED, TAGS + "[flat]", ("['flat']", "a mapping")),
    ('worldConfigs: [{world: "${{ world }}"}]', 'worldConfigs: {world: "${{ world }}"}', ("a mapping", "a list")),
    ("    operation: CreateWorldExportJob", "    operation: [CreateWorldExportJob]", ("CreateWorldExportJob", "text")),
    (EXPORT, f"{EXPORT}    needs: worlds\n", ("'worlds'", "a list")),
    # Out of range
    ("floorplanCount: 2", "floorplanCount: 0", ("is 0", "at least 1")),
    ("floorplanCount: 2", "floorplanCount: 2147483648", ("is 2147483648", "at most 2147483647")),
    ("seed: 7", "seed: -7", ("is -7", "at least 0")),
    ("seed: 7", f"seed: {10**30}", (str(10**30), str(2**63 - 1))),
    ("Area: 14", "Area: 1", ("1:", "or more would be right")),
    ("Area: 14", "Area: 400", ("400:", "300 or less")),
    ("Height: 2.6", "Height: 10", ("10:", "4 or less")),
    ("{x: 4, y: 3}", "{x: 9, y: 3}", ("9:", "4 or less")),
    ("maxConcurrency: 2", "maxConcurrency: 0", ("is 0", "at least 1")),
    ("maxJobDurationInSeconds: 300", "maxJobDurationInSeconds: 9999999", ("9999999", "at most 1209600")),
    # Unknown names
    ("CreateWorldGenerationJob", "CreateWorldGenerationJobs", ("Jobs'", "did you mean 'CreateWorldGenerationJob'")),
    ("Type: Kitchen", "Type: Kichen", ('"Kichen"', '"Kitchen"')),
    ("Type: Kitchen", "Type: Sauna", ('"Sauna"', "'Hallway'")),
    ("Sofas", "Sofa", ('"Sofa"', '"Sofas"')),
    ("Floorboards", "Lava", ('"Lava"', "Parquetry")),
    ("DesiredSpatialDensity: Sparse", "DesiredSpatialDensity: Full", ('"Full"', "'Dense'")),
    ("ConnectionType: Opening", "ConnectionType: Door", ('"Door"', '"Doorway"')),
    ("[Living room, Kitchen]", "[Living room, Kichen]", ('"Kichen"', "no such room", '"Kitchen"')),
    ("[Living room, Kitchen]", "[Living room, Pool]", ('"Pool"', "the rooms are", '"Bedroom"')),
    ("RoomNames: [Living room]", "RoomNames: [Livin room]", ('"Livin room"', '"Living room"')),
    ("iamRole: arn:aws:iam::000000000000:role/local", "iamRole: admin", ("'admin'", "arn:aws:iam::")),
    ("s3Bucket: robomaker, s3P", "s3Bucket: Robo_Maker, s3P", ("'Robo_Maker'", "small letters")),
    ("Name: Kitchen,", "Name: Küche,", ("Küche", "letters, digits")),
    ("application: scout", "application: my robot", ("'my robot'", "ARN", "name")),
    (SEED, TAGS + '{"aws:flat": x}', ("'aws:flat'", "reserved", "rename")),
    ("name: quickstart", "name: quick start!", ("'quick start!'", "letters, digits, - and _")),
    ("          seed: 1\n", "          seed: 1\n          video: yes\n", ("'yes'", "'always'")),
    # Contradictions
    ("[Living room, Kitchen]", "[Living room, Living room]", ('"Living room"', "two different rooms")),
    ("[Living room, Bedroom], Con", "[Kitchen, Living room], Con", ("Doorway", "connected before", "one Opening")),
    ("Name: Kitchen,", "Name: Living room,", ('"Living room"', "taken by Rooms[0]")),
    ("RoomNames: [Kitchen]", "RoomNames: [Kitchen], RoomTypes: [Kitchen]", ("both RoomNames and RoomTypes", "one of")),
    (EXPORT, f"{EXPORT}    ifExists: reuse\n", ("'reuse'", "CreateRobotApplication", "remove")),
    ("  worlds:\n", "  worlds:\n    needs: [drive]\n", ("wait for each other", "worlds -> drive -> worlds")),
    # References
    ("${{ template.arn }}", "${{ tempalte.arn }}", ("'tempalte'", "'template'")),
    ("${{ template.arn }}", "${{ template.ar }}", ("'ar'", "'arn'")),
    ("${{ template.arn }}", "${{ template.arn", ("not closed", "}}")),
    ("${{ template.arn }}", "template", ("'template'", "an ARN")),
    ("${{ template.arn }}", "${{ template.tags }}", ("a mapping", "text")),
    (f"forEach: {SUCCEEDED}", "forEach: ${{ worlds.status }}", ("worlds.status", "text", "a list")),
    ("as: world", "as: 1world", ("'1world'", "letters, digits and _")),
    ("as: world", "as: template", ("'template'", "another name")),
    ("${{ world }}", "${{ word }}", ("'word'", "'world'")),
    (EXPORT, f"{EXPORT}    needs: [wrlds]\n", ("'wrlds'", "'worlds'")),
    # YAML
    ("    operation: CreateWorldExportJob", "\toperation: CreateWorldExportJob", ("\\t", "spaces")),
    (EXPORT, "  worlds:\n", ("'worlds'", "twice", "line 76")),
    ("seed: 7", "seed: !!python/name:os.system 7", ("python/name", "not allowed")),
]  # fmt: skip


def broken(right: str, wrong: str) -> tuple[str, int]:
    """The specification with one mistake, and the line that it begins in."""
    text = QUICKSTART.read_text()
    before, found, after = text.partition(right)
    assert found
    return before + wrong + after, before.count("\n") + 1


@pytest.mark.parametrize(("right", "wrong", "words"), MISTAKES, ids=[f"{row[1].strip()[:40]}" for row in MISTAKES])
def test_one_mistake_is_told_once_with_place_value_and_remedy(right: str, wrong: str, words: tuple[str, ...]) -> None:
    text, line = broken(right, wrong)

    with pytest.raises(SpecError) as refused:
        load_spec(text, "spec.yaml")

    [problem] = refused.value.problems
    for word in words:
        assert word in str(problem)
    assert "\n" not in str(problem)
    assert (problem.place.file, problem.place.column > 0) == ("spec.yaml", True)
    # What is missing is told at what should hold it, a circle at its first step.
    assert line - 10 <= problem.place.line <= line + 1
    if "missing" not in problem.message and "wait for" not in problem.message:
        assert problem.place.line >= line


@pytest.mark.parametrize("index", [0, 17, 31, 47, 57, 63, 73])
def test_the_command_refuses_and_creates_nothing(
    index: int, tmp_path: Path, robomaker: Callable[..., tuple[int, str, str]]
) -> None:
    right, wrong, words = MISTAKES[index]
    path, home = tmp_path / "spec.yaml", tmp_path / "home"
    path.write_text(broken(right, wrong)[0])

    code, out, err = robomaker(home, "run", path)

    assert (code, out) == (2, "")
    first, count = err.splitlines()
    assert first.startswith(f"{path}:")
    assert all(word in first for word in words)
    assert count.startswith(f"robomaker: 1 problem in {path}; nothing was run; ")
    assert not home.exists()


@pytest.mark.parametrize(
    ("text", "line", "column", "words"),
    [
        ("", 1, 1, ("empty",)),
        ("\n\n", 1, 1, ("empty",)),
        ("hello", 1, 1, ("mapping", "version, name and steps")),
        ("- 1\n", 1, 1, ("mapping",)),
        ("version: 1\nname: x\nsteps: {}\n", 3, 8, ("steps", "at least 1")),
        ("version: 1\nname: x\nsteps:\n  a: {operation: ListWorlds, input: {a: ${{ x }}}}", 4, None, ("quotes",)),
        ("a: [1\nb: 2", 2, None, ("not YAML",)),
        ("a: &x [*x]", 1, None, ("no anchor",)),
        ("<<: {a: 1}", 1, 1, ("merge keys",)),
        ("a: 1\n---\nb: 2", 3, 1, ("one document",)),
        ("[" * 100 + "]" * 100, 1, None, ("nested",)),
        ("a: 1\0", 1, None, ("not YAML",)),
        ("a: " + "9" * 500, 1, 4, ("not a number",)),
        ("x" * 2_000_000, 1, 1, ("larger than 1024 KiB",)),
    ],
)  # fmt: skip
def test_what_is_no_specification_at_all(text: str, line: int, column: int | None, words: tuple[str, ...]) -> None:
    with pytest.raises(SpecError) as refused:
        load_spec(text, "spec.yaml")

    problem = refused.value.problems[0]
    assert problem.place.line == line
    assert column in (None, problem.place.column)
    for word in words:
        assert word in str(problem)


@pytest.mark.parametrize("change", [lambda text: text.replace("\n", "\r\n"), lambda text: f"\ufeff{text}"])
def test_line_ends_and_byte_order_marks_of_other_systems_are_fine(change) -> None:
    text = QUICKSTART.read_text()

    checked = load_spec(change(text), "spec.yaml")

    assert checked.order == load_spec(text, "spec.yaml").order
    places = [(step.place.line, step.place.column) for step in checked.steps.values()]
    assert places == [(step.place.line, step.place.column) for step in load_spec(text, "spec.yaml").steps.values()]
