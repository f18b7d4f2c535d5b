"""Everything that is wrong with a specification is told at once, and nothing that only comes of something else."""

# ruff: noqa: E501 - a table with one case in a line reads best

import json
from collections.abc import Iterable
from functools import cache
from itertools import combinations
from typing import NamedTuple

import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.yaml_nodes import parse, plain
from prefect_robomaker.schemas.wire.errors import SpecError

GOOD = """\
version: 1
name: flat-night
description: Two robots in a flat.
parameters:
  worlds: {type: integer, minimum: 1, maximum: 50, default: 4}
  arm: {enum: [control, treatment], default: control}
  label: {default: flat, pattern: '^[a-z]'}
steps:
  robot:
    operation: CreateRobotApplication
    ifExists: reuse
    input:
      name: rover
      robotSoftwareSuite: {name: ROS2, version: Foxy}
      sources: [{s3Bucket: code, s3Key: rover.zip, architecture: X86_64}]
  template:
    operation: CreateWorldTemplate
    input:
      name: ${{ parameters.label }}
      templateBody:
        Version: "2"
        Buildings:
          - Floors:
              - Floorplan:
                  Rooms:
                    - {Type: Living, Name: living room, DesiredShape: {Area: 24, AspectRatio: {x: 3, y: 2}}}
                    - {Type: Bedroom, Name: bedroom, DesiredShape: {Area: 14, AspectRatio: {x: 1, y: 1}}}
                  DesiredConnections:
                    - {Location: [living room, bedroom], ConnectionType: Doorway}
                Interior:
                  Furniture:
                    FurnitureArrangements:
                      - Name: beds
                        TargetSet: {RoomNames: [bedroom]}
                        SampleSet: {ModelTypes: [Beds]}
                        DesiredSpatialDensity: Dense
  worlds:
    operation: CreateWorldGenerationJob
    input:
      template: ${{ template.arn }}
      worldCount: {floorplanCount: "${{ parameters.worlds }}", interiorCountPerFloorplan: 1}
      seed: 7
  drive:
    operation: StartSimulationJobBatch
    needs: [robot]
    input:
      batchPolicy: {maxConcurrency: 2, timeoutInSeconds: 3600}
      tags: {arm: "${{ parameters.arm }}"}
      createSimulationJobRequests:
        forEach: ${{ worlds.finishedWorldsSummary.succeededWorlds }}
        as: world
        value:
          maxJobDurationInSeconds: 300
          iamRole: arn:aws:iam::000000000000:role/local
          robotApplications:
            - application: scout
              launchConfig: {environmentVariables: {ARM: "the ${{ parameters.arm }} arm ${{ index }}"}}
          simulationApplications:
            - application: indoor-navigation
              launchConfig: {}
              worldConfigs: [{world: "${{ world }}"}]
          requirements:
            - {kind: goal, name: sleep, room: bedroom}
            - {kind: no_collision, name: gentle, max_force_N: 20}
            - {kind: goal, name: home, room: living room, after: sleep}
          trials:
            seeds: 3
            record: [2]
            axes:
              mass: {kind: robot_mass, values: [1, 2]}
              slip: {kind: robot_friction, values: [0.5, 1]}
              SPEED: {kind: variable, values: ["1", "2"]}
            include:
              - {mass: 0.8}
            exclude:
              - {mass: 2, SPEED: "2"}
  single:
    operation: CreateSimulationJob
    input:
      maxJobDurationInSeconds: 60
      iamRole: arn:aws:iam::000000000000:role/local
      robotApplications:
        - application: rover
          launchConfig: {packageName: nav, launchFile: drive.make_agent}
      simulationApplications:
        - application: indoor-navigation
          launchConfig: {}
          worldConfigs: [{world: "${{ worlds.finishedWorldsSummary.succeededWorlds[0] }}"}]
      video: on-failure
      # more of single
  look:
    operation: DescribeWorld
    needs: [drive, single]
    # more of look
    input: {world: "${{ join('/', [worlds.arn, template.name]) }}"}
  later:
    operation: ListWorlds
    needs: [look]
  cells:
    operation: "StartSimulationJobBatch"
    input:
      createSimulationJobRequests:
        axes:
          limit: {values: ["25", "4"]}
          gain: {range: [0.5, 2]}
        design: random
        points: 5
        include:
          - {limit: "4", gain: 1}
        seeds: 2
        value:
          maxJobDurationInSeconds: 30
          robotApplications: [{application: scout, launchConfig: {environmentVariables: {GAIN: "${{ to_string(gain) }}"}}}]
          simulationApplications:
            - application: indoor-navigation
              worldConfigs: [{world: flat}]
              launchConfig: {environmentVariables: {ROBOMAKER_SIM_TIME_LIMIT_S: "${{ limit }}"}}
  grid:
    operation: "StartSimulationJobBatch"
    input:
      createSimulationJobRequests:
        axes:
          wide: {values: ["0.8", "1.2"]}
          long: {values: ["3", "4"]}
        exclude:
          - {wide: "0.8", long: "3"}
          - {long: "4", wide: "1.2"}
        seeds: 4
        value:
          maxJobDurationInSeconds: 30
          robotApplications: [{application: scout, launchConfig: {environmentVariables: {SIZE: "${{ wide }} ${{ long }}"}}}]
          simulationApplications:
            - {application: indoor-navigation, launchConfig: {}, worldConfigs: [{world: flat}]}
"""


class Mistake(NamedTuple):
    """One mistake: what is written instead of what, and what is said about it."""

    good: str
    bad: str
    said: str
    """Text from the column on."""

    unknown_beside: tuple[str, ...] = ()
    """Texts of other mistakes; whether this is one is not known before these are mended."""


# Cells and seeds, which say how many trials there are.
_TRIALS = ("seeds: 0", "seeds: 300000", "robot_mas,", "1_0", "mass: heavy", "wheel", 'SPEED: "9"', "{limit: 5}")
# A name of two rooms, of which one has another name that is not known.
_TWICE = "Name: living room, Desired"
MISTAKES = [
    Mistake("version: 1\n", "version: 3\n", "10: version: is 3; it has to be 1"),
    Mistake("version: 1\n", "vresion: 1\n", "1: vresion: is not known; did you mean 'version'?"),
    Mistake("name: flat-night", "name: flat night", "7: name: is 'flat night'; it has to be of letters, digits, - and _, with a letter or digit in front"),
    Mistake("description: Two robots in a flat.", "description: 12", '14: description: is 12; it has to be text'),
    Mistake("description: Two", "remark: Two", "1: remark: is not known; known are version, name, description, parameters, sabotages, known, steps"),
    # Parameters
    Mistake("minimum: 1, maximum: 50, default: 4", "minimum: 1, maximum: 0, default: 4", "36: parameters.worlds.minimum: is 1; it may be at most the maximum, 0"),
    Mistake("maximum: 50, default: 4", "maximum: 50, default: four", "61: parameters.worlds.default: is 'four'; it has to be a whole number"),
    Mistake("{type: integer, minimum: 1", "{type: int, minimum: 1", "18: parameters.worlds.type: is 'int'; it has to be 'string', 'integer', 'number' or 'boolean'"),
    Mistake("{enum: [control, treatment], default", "{enum: [control, treatment], defualt", "37: parameters.arm.defualt: is not known; did you mean 'default'?"),
    Mistake("treatment], default: control", "treatment], default: contrl", "46: parameters.arm.default: is 'contrl'; it has to be control or treatment; did you mean 'control'?"),
    Mistake("label: {default: flat, pattern: '^[a-z]'}", "label: {default: flat, pattern: '^[a-z'}", "35: parameters.label.pattern: is '^[a-z'; it is no regular expression: unclosed character class"),
    # Steps
    Mistake("operation: CreateRobotApplication\n", "operation: CreateRobotAplication\n", "16: steps.robot.operation: there is no operation 'CreateRobotAplication'; did you mean 'CreateRobotApplication'?"),
    Mistake("operation: CreateWorldGenerationJob\n", "operation: CreateWorldGenerationJbo\n", "16: steps.worlds.operation: there is no operation 'CreateWorldGenerationJbo'; did you mean 'CreateWorldGenerationJob'?"),
    Mistake("operation: StartSimulationJobBatch", "opration: StartSimulationJobBatch", "5: steps.drive.opration: is not known; did you mean 'operation'?"),
    Mistake("operation: StartSimulationJobBatch", "operation: StartSimulationJobsBatch", "16: steps.drive.operation: there is no operation 'StartSimulationJobsBatch'; did you mean 'StartSimulationJobBatch'?"),
    Mistake("operation: ListWorlds", "operation: [ListWorlds]", "16: steps.later.operation: is ['ListWorlds']; it has to be text"),
    Mistake("ifExists: reuse", "ifExists: maybe", "15: steps.robot.ifExists: is 'maybe'; it has to be 'fail', 'reuse' or 'update'"),
    Mistake("    needs: [robot]\n", "    needs: [robt]\n", "13: steps.drive.needs[0]: there is no step 'robt'; did you mean 'robot'?"),
    Mistake("    needs: [look]\n", "    needs: [look, later]\n", "19: steps.later.needs[1]: needs itself; leave it out"),
    Mistake("    needs: [drive, single]", "    needs: drive", "12: steps.look.needs: is 'drive'; it has to be a list: [drive]"),
    Mistake("    # more of look", "    retries: 3", "5: steps.look.retries: is not known; known are operation, input, needs, ifExists"),
    # Inputs
    Mistake("      name: rover", "      nam: rover", "7: steps.robot.input.nam: is not known; did you mean 'name'?"),
    Mistake("version: Foxy}", "version: Humble}", "49: steps.robot.input.robotSoftwareSuite.version: is 'Humble'; it has to be 'Kinetic', 'Melodic', 'Dashing' or 'Foxy'; for Humble write Foxy, for later releases leave it out: the ROS of the application runs, whatever it says"),
    Mistake("s3Bucket: code, s3Key: rover.zip", "s3Key: rover.zip", "16: steps.robot.input.sources: source 0 needs both s3Bucket and s3Key"),
    Mistake("worldCount: {floor", "worldcount: {floor", "7: steps.worlds.input.worldcount: is not known; did you mean 'worldCount'?"),
    Mistake("seed: 7", "seed: seven", "13: steps.worlds.input.seed: is 'seven'; it has to be a whole number"),
    Mistake("seed: 7", "sed: 7", "7: steps.worlds.input.sed: is not known; did you mean 'seed'?"),
    Mistake("      template: ${{ template.arn }}\n", "      template: ${{ template.uri }}\n", "17: steps.worlds.input.template: CreateWorldTemplateResponse has no member 'uri'; there are arn, clientRequestToken, createdAt, name, tags"),
    Mistake("      template: ${{ template.arn }}\n", "      template: ${{ templat.arn }}\n", "17: steps.worlds.input.template: there is no step or variable 'templat'; did you mean 'template'?"),
    Mistake("{maxConcurrency: 2,", "{maxConcurrency: two,", "37: steps.drive.input.batchPolicy.maxConcurrency: is 'two'; it has to be a whole number"),
    Mistake('tags: {arm: "${{ parameters.arm }}"}', 'tags: {arm: "${{ parameters.amr }}"}', "19: steps.drive.input.tags.arm: there is no parameter 'amr'; did you mean 'arm'?"),
    Mistake("        forEach: ${{ worlds.fin", "        foreach: ${{ worlds.fin", "9: steps.drive.input.createSimulationJobRequests.foreach: is not known; did you mean 'forEach'?"),
    Mistake("finishedWorldsSummary.succeededWorlds }}\n", "finishedWorldsSummary.finishedCount }}\n", "18: steps.drive.input.createSimulationJobRequests.forEach: is ${{ worlds.finishedWorldsSummary.finishedCount }}, a whole number; it has to be a list or a reference to one: ${{ step.list }}"),
    Mistake("        as: world\n", "        as: worlds\n", "13: steps.drive.input.createSimulationJobRequests.as: 'worlds' already means something else; choose another name"),
    Mistake("        as: world\n", "        az: world\n", "9: steps.drive.input.createSimulationJobRequests.az: is not known; known are forEach, as, value"),
    Mistake("          maxJobDurationInSeconds: 300\n", "          # no duration\n", "value.maxJobDurationInSeconds: is missing"),
    Mistake("          iamRole: arn:aws:iam::000000000000:role/", "          iamRole: arn:aws:iam::000000000000:rol/", "value.iamRole: is 'arn:aws:iam::000000000000:rol/local'; it has to be the ARN of a role"),
    Mistake("application: scout\n", "application: [scout]\n", "28: steps.drive.input.createSimulationJobRequests.value.robotApplications[0].application: is ['scout']"),
    Mistake("{ARM: \"the ", "{arm: \"the ", "environmentVariables.arm: the key is 'arm'; it has to be of capital letters"),
    Mistake('[{world: "${{ world }}"}]', '[{world: "${{ index }}"}]', "worldConfigs[0].world: ${{ index }} is a whole number; it has to be text"),
    Mistake("{kind: goal, name: sleep, room: bedroom}", "{kind: goal, name: sleep, room: bathroom}", "the world has no room 'bathroom'; did you mean 'bedroom'? Its rooms are living room, bedroom", ("templat.", "as: worlds", "az: world", "${{ index }}\"}]", _TWICE)),
    Mistake("{kind: goal, name: sleep, room: bedroom}", "{kind: gaol, name: sleep, room: bedroom}", "requirements[0].kind: is 'gaol'; did you mean 'goal'?"),
    Mistake("{kind: goal, name: sleep, room: bedroom}", "{kind: goal, name: sleep, rom: bedroom}", "requirements[0].rom: is not known; did you mean 'room'?"),
    Mistake("{kind: no_collision, name: gentle, max_force_N: 20}", "{kind: no_collision, name: gentle, max_force_N: 20, hard: 1}", "requirements[1].hard: is not known"),
    Mistake("{kind: no_collision, name: gentle, max_force_N: 20}", "{kind: no_collision, name: sleep, max_force_N: 20}", "requirements names have to differ; 'sleep' appears more than once"),
    Mistake("after: sleep}", "after: slep}", "requirements[2]: home: after is 'slep', no goal further up; those before it are sleep"),
    Mistake("seeds: 3\n", "seeds: 0\n", "trials.seeds: is 0; it has to be at least 1"),
    Mistake("seeds: 3\n", "seeds: 300000\n", "trials: 300000 seeds for each of 7 cells are 2100000 trials", _TRIALS),
    Mistake("record: [2]", "record: [50]", "trials.record[0]: there is no trial 50; the trials are 0 to 20", _TRIALS),
    Mistake("{kind: robot_mass, values: [1, 2]}", "{kind: robot_mas, values: [1, 2]}", "axes.mass.kind: is 'robot_mas'; did you mean 'robot_mass'?"),
    Mistake("values: [0.5, 1]}", "values: [0.5, 1_0]}", "58: steps.drive.input.createSimulationJobRequests.value.trials.axes.slip.values[1]: '1_0' is no number"),
    Mistake("              - {mass: 0.8}", "              - {mass: heavy}", "24: steps.drive.input.createSimulationJobRequests.value.trials.include[0].mass: 'heavy' is no number"),
    Mistake("              - {mass: 0.8}", "              - {wheel: 0.8}", "25: steps.drive.input.createSimulationJobRequests.value.trials.include[0].wheel: there is no axis 'wheel'"),
    Mistake('- {mass: 2, SPEED: "2"}', '- {mass: 2, SPEED: "9"}', "34: steps.drive.input.createSimulationJobRequests.value.trials.exclude[0].SPEED: the axis has no value '9'"),
    Mistake("      maxJobDurationInSeconds: 60\n", "      maxJobDurationInSeconds: 60.5\n", "32: steps.single.input.maxJobDurationInSeconds: is 60.5; it has to be a whole number"),
    Mistake("      video: on-failure", "      video: sometimes", "14: steps.single.input.video: is 'sometimes'; it has to be"),
    Mistake("      # more of single", "      policy: \"\"", "steps.single.input.policy"),
    Mistake("succeededWorlds[0] }}", "succeededWorlds.first }}", "'first' is asked of a list, which has no members; choose entries with [0] or [*]"),
    Mistake("join('/', [", "jion('/', [", "there is no function jion(); did you mean 'join'?"),
    # Rules about several members, beside which others are wrong
    Mistake("{kind: goal, name: sleep, room: bedroom}", "{kind: goal, name: sleep, room: bedroom, by_s: fast}", "requirements[0].by_s: is 'fast'; it has to be a number"),
    Mistake("max_force_N: 20}", "max_force_N: hard}", "requirements[1].max_force_N: is 'hard'; it has to be a number"),
    Mistake("name: home, room", "name: sleep, room", "requirements names have to differ; 'sleep' appears more than once"),
    Mistake('- {mass: 2, SPEED: "2"}', "- {limit: 5}", "trials.exclude[0].limit: there is no axis 'limit'"),
    # Axes of a step
    Mistake('limit: {values: ["25", "4"]}', "limit: {values: []}", "axes.limit.values: is an empty list"),
    Mistake("gain: {range: [0.5, 2]}", "gain: {range: [2, 0.5]}", "axes.gain.range: 2 is not below 0.5"),
    Mistake("design: random", "design: latin", "design: is 'latin'; it has to be"),
    Mistake("points: 5", "points: 0", "points: is 0; it has to be at least 1"),
    Mistake('{limit: "4", gain: 1}', '{limit: "4", gain: much}', "include[0].gain: 'much' is no number", ("[2, 0.5]",)),
    Mistake('{limit: "4", gain: 1}', '{limt: "4", gain: 1}', "include[0].limt: there is no axis 'limt'; did you mean 'limit'?"),
    Mistake("        seeds: 2\n", "        seeds: 0\n", "createSimulationJobRequests.seeds: is 0; it has to be at least 1"),
    Mistake('wide: {values: ["0.8", "1.2"]}', 'wide: {values: [["0.8"], "1.2"]}', "axes.wide.values[0]"),
    Mistake('long: {values: ["3", "4"]}', 'long: {values: ["3", "4"], range: [1, 2]}', "axes.long"),
    Mistake('{wide: "0.8", long: "3"}', '{wide: "0.9", long: "3"}', "exclude[0].wide: the axis has no value '0.9'", ('[["0.8"]',)),
    Mistake('{long: "4", wide: "1.2"}', '{lng: "4"}', "exclude[1].lng: there is no axis 'lng'"),
    Mistake("        seeds: 4\n", "        seeds: four\n", "createSimulationJobRequests.seeds: is 'four'; it has to be a whole number"),
    # Template bodies
    Mistake("Name: bedroom, Desired", "Name: living room, Desired", 'Rooms[1].Name: "living room": taken by Rooms[0]'),
    Mistake('Version: "2"', "Version: 2", '18: steps.template.input.templateBody.Version: 2: no such version'),
    Mistake("Name: bedroom, Desired", "Nam: bedroom, Desired", "Floorplan.Rooms[1].Nam: unknown member; did you mean \"Name\"?"),
    Mistake("{Area: 14, ", "{Area: small, ", "Rooms[1].DesiredShape.Area: \"small\": a number would be right"),
    Mistake("{Area: 24, ", "{Area: 2, ", "Rooms[0].DesiredShape.Area: 2: "),
    Mistake("Location: [living room, bedroom]", "Location: [living room, kitchen]", "DesiredConnections[0].Location[1]: \"kitchen\": no such room", (_TWICE,)),
    Mistake("RoomNames: [bedroom]", "RoomNames: [bedrom]", 'TargetSet.RoomNames[0]: "bedrom": no such room; did you mean "bedroom"?', (_TWICE,)),
    Mistake("ModelTypes: [Beds]", "ModelTypes: [Bedds]", "SampleSet.ModelTypes[0]: \"Bedds\""),
]  # fmt: skip


def told(text: str) -> list[str]:
    try:
        load_spec(text, "s.yaml", most_worlds=50)
    except SpecError as error:
        return [str(problem) for problem in error.problems]
    return []


def with_mistakes(mistakes: Iterable[Mistake]) -> str:
    text = GOOD
    for mistake in mistakes:
        text = text.replace(mistake.good, mistake.bad)
    return text


@cache
def told_alone(mistake: Mistake) -> tuple[str, ...]:
    return tuple(told(with_mistakes([mistake])))


@cache
def lines_of(mistake: Mistake) -> frozenset[int]:
    """The lines that a mistake is on: places of two on one line would move."""
    first = GOOD.count("\n", 0, GOOD.index(mistake.good))
    return frozenset(range(first, first + mistake.good.rstrip("\n").count("\n") + 1))


def independent(mistakes: Iterable[Mistake]) -> list[Mistake]:
    """Mistakes on lines of their own, each of which can be known beside the others."""
    kept: list[Mistake] = []
    for mistake in mistakes:
        if not any(lines_of(mistake) & lines_of(other) or may_hide(mistake, other) for other in kept):
            kept.append(mistake)
    return kept


def may_hide(first: Mistake, second: Mistake) -> bool:
    pairs = ((first, second), (second, first))
    return any(part in hiding.bad for hidden, hiding in pairs for part in hidden.unknown_beside)


def test_the_good_one_is_good() -> None:
    assert told(GOOD) == []
    assert len(MISTAKES) > 60


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda each: each.bad.strip()[:50])
def test_each_mistake_alone_is_told_once_at_its_place(mistake: Mistake) -> None:
    assert GOOD.count(mistake.good) == 1
    assert mistake.good.count("\n") == mistake.bad.count("\n"), "lines of other mistakes would move"

    (line,) = told_alone(mistake)

    assert mistake.said in line
    number = int(line.split(":")[1]) - 1
    assert min(lines_of(mistake)) - 2 <= number <= max(lines_of(mistake)), "at the value, or at the key it belongs to"


@examples(60)
@given(st.lists(st.sampled_from(MISTAKES), min_size=2, max_size=12, unique=True))
def test_many_mistakes_are_told_at_once_and_nothing_else(mistakes: list[Mistake]) -> None:
    made = independent(mistakes)

    assert sorted(told(with_mistakes(made))) == sorted({line for each in made for line in told_alone(each)})


def rounds_of_all_pairs() -> list[list[Mistake]]:
    """Lists of independent mistakes, in which each two that are independent are together at least once.

    A mistake that hides another one hides it also beside more, so that some dozens of files do for 2,000 pairs.
    """
    left = [pair for pair in combinations(MISTAKES, 2) if len(independent(pair)) == 2]
    rounds: list[list[Mistake]] = []
    while left:
        together = independent([*left[0], *(each for pair in left for each in pair), *MISTAKES])
        rounds.append(together)
        left = [pair for pair in left if not (pair[0] in together and pair[1] in together)]
    return rounds


@pytest.mark.deep
def test_no_mistake_hides_another() -> None:
    for made in rounds_of_all_pairs():
        assert sorted(told(with_mistakes(made))) == sorted({line for each in made for line in told_alone(each)})


def test_all_mistakes_are_mended_in_one_round() -> None:
    """One who mends what was told, line by line, is done."""
    made = independent(MISTAKES)
    lines, good = with_mistakes(made).splitlines(), GOOD.splitlines()
    found = told(with_mistakes(made))
    assert len(found) == len(made) > 40

    for problem in found:
        number = int(problem.split(":")[1]) - 1
        mended = next(lines_of(each) for each in made if number in lines_of(each) or problem in told_alone(each))
        for each in mended:
            lines[each] = good[each]

    assert told("\n".join(lines) + "\n") == []


def test_every_circle_of_steps_is_told() -> None:
    steps = ("a: [b]", "b: [a]", "c: [c]", "d: [e]", "e: [f]", "f: [d, a]", "g: [f]")
    lines = (
        f"  {name}: {{operation: ListWorlds, needs: {needs}}}\n" for name, needs in (each.split(": ") for each in steps)
    )
    assert told(f"version: 1\nname: circles\nsteps:\n{''.join(lines)}") == [
        "s.yaml:4:3: steps.a: these steps wait for each other: a -> b -> a",
        "s.yaml:6:38: steps.c.needs[0]: needs itself; leave it out",
        "s.yaml:7:3: steps.d: these steps wait for each other: d -> e -> f -> d",
    ]


def test_circles_with_a_common_edge_are_one_problem() -> None:
    """One wrong `needs` closes a circle with each way that leads back to its step."""
    steps = ("a: [d]", "b: [a]", "c: [a]", "d: [b, c]")
    lines = (
        f"  {name}: {{operation: ListWorlds, needs: {needs}}}\n" for name, needs in (each.split(": ") for each in steps)
    )
    assert told(f"version: 1\nname: circles\nsteps:\n{''.join(lines)}") == [
        "s.yaml:7:3: steps.d: these steps wait for each other: d -> b -> a -> d"
    ]


def test_what_comes_of_another_problem_is_not_told() -> None:
    """Steps and parameters that are wrong themselves are there: references to them say nothing."""
    text = """\
version: 1
name: one
parameters: {size: {type: wide}}
steps:
  nothing: just text
  unknown: {operation: MakeSomething, input: {size: "${{ parameters.size }}"}}
  look: {operation: DescribeWorld, needs: [nothing], input: {world: "${{ unknown.worlds[0].arn }}/${{ nothing.arn }}"}}
"""
    assert [line.split(": ")[1] for line in told(text)] == [
        "parameters.size.type",
        "steps.nothing",
        "steps.unknown.operation",
    ]


def test_members_of_a_guessed_kind_are_told_after_the_kind() -> None:
    text = GOOD.replace("{kind: no_collision, name: gentle, max_force_N: 20}", "{name: gentle, kind: colision}")
    assert [line.split("requirements[1].")[1][:25] for line in told(text)] == [
        "kind: is 'colision'; did ",
        "max_force_N: is missing; ",
    ]


def replaced(value: object, number: int, junk: object) -> tuple[object, int]:
    """Plain data with junk in the place of the value of a number, counted through; and the numbers that are left."""
    if number == 0:
        return junk, -1
    number -= 1
    if isinstance(value, dict):
        changed: dict[object, object] = {}
        for key, each in value.items():
            changed[key], number = (each, number) if number < 0 else replaced(each, number, junk)
        return changed, number
    if isinstance(value, list):
        items: list[object] = []
        for each in value:
            item, number = (each, number) if number < 0 else replaced(each, number, junk)
            items.append(item)
        return items, number
    return value, number


JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from(
        [0, -1, 10**30, 1.5, "", "x", "${{ worlds.arn }}", "${{ parameters.arm }}", "${{ nowhere }}", "${{"]
    ),
    st.sampled_from([[], {}, [[]], [None], {"forEach": "x"}, {"forEach": [1], "value": {}}, {"kind": "goal"}, {"": 1}]),
)


@cache
def good_document() -> object:
    """The good specification as plain data, which `replaced` leaves as it is; it is read once, as that takes 0.3 s."""
    return plain(parse(GOOD, "s.yaml"))


@examples(150)
@given(st.lists(st.tuples(st.integers(0, 250), JUNK), min_size=1, max_size=4))
def test_whatever_stands_somewhere_is_told_and_breaks_nothing(changes: list[tuple[int, object]]) -> None:
    document = good_document()
    for number, junk in changes:
        document, _ = replaced(document, number, junk)

    found = told(json.dumps(document))

    assert len(found) == len(set(found))
    assert not any("placeholder" in line for line in found), "nothing that was put in to look further is told"
