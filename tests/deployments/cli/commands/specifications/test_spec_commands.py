"""validate and plan."""

import json
import re
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.reports.names import name_label
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.service.service import Service

SPECS = REPOSITORY / "deployments" / "specs"
WRONG = "version: 1\nname: wrong\nsteps:\n  first: {operation: DescribeWorld, input: {wrld: 'arn:1'}}\n"

COLUMN = WRONG.splitlines()[3].index("wrld") + 1


def test_valid_files_are_said_to_be(robomaker) -> None:
    ended = robomaker("validate", SPECS / "quickstart.yaml", SPECS / "nightly.yaml")
    assert (ended.code, ended.err) == (0, "")
    assert ended.out == f"{SPECS}/quickstart.yaml: valid, 4 steps\n{SPECS}/nightly.yaml: valid, 5 steps\n"

    seeds = SPECS / "examples" / "fault_found" / "courier.yaml"
    assert robomaker("validate", seeds).out == f"{seeds}: valid, 3 steps, 16 simulation jobs\n", "seeds without axes"


def test_every_file_is_checked_whatever_is_wrong_with_others(robomaker, spec) -> None:
    path = spec(WRONG)
    ended = robomaker("validate", "nowhere.yaml", path, SPECS / "quickstart.yaml")
    assert ended.code == 2
    assert ended.out == f"{SPECS}/quickstart.yaml: valid, 4 steps\n"
    assert "nowhere.yaml: no such file" in ended.err
    assert f"{path}:4:{COLUMN}: steps.first.input.wrld: is not known; did you mean 'world'?" in ended.err
    assert f"robomaker: 1 problem in {path}; nothing was run" in ended.err


def test_problems_as_json(robomaker, spec) -> None:
    path = spec(WRONG)
    ended = robomaker("validate", path, "-o", "json")
    assert ended.code == 2
    document = json.loads(ended.out)
    assert document["schema_version"] == 1
    (file,) = document["files"]
    assert (file["file"], file["valid"]) == (str(path), False)
    (unknown,) = [problem for problem in file["problems"] if problem["path"] == "steps.first.input.wrld"]
    assert (unknown["line"], unknown["column"]) == (4, COLUMN)
    assert unknown["message"] == "is not known; did you mean 'world'?"


def test_an_application_that_only_the_catalog_may_know_is_noted_and_no_problem(robomaker, spec) -> None:
    text = """\
version: 1
name: night
steps:
  drive:
    operation: CreateSimulationJob
    input:
      iamRole: arn:aws:iam::000000000000:role/local
      maxJobDurationInSeconds: 60
      robotApplications: [{application: scouty, launchConfig: {}}]
"""
    path = spec(text)
    said = (
        "there is no built-in robot application 'scouty', and no step makes one; did you mean 'scout'? "
        "If it is in the catalog, a run finds it"
    )

    ended = robomaker("validate", path)
    assert (ended.code, ended.out) == (0, f"{path}: valid, 1 step\n")
    assert ended.err == f"{path}:9:41: steps.drive.input.robotApplications[0].application: note: {said}\n"
    (file,) = json.loads(robomaker("validate", path, "-o", "json").out)["files"]
    assert (file["valid"], file["problems"], [note["message"] for note in file["notes"]]) == (True, [], [said])

    ended = robomaker("validate", spec(text.replace("version: 1", "version: 2")))
    assert ended.code == 2
    assert f": note: {said}\n" in ended.err, "it is told beside problems"


def test_github_gets_annotations(robomaker, spec, monkeypatch) -> None:
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    path = spec("version: 1\nname: wrong\nsteps: {first: {operation: 100%}}\n")
    assert (
        f"::error file={path},line=3,col=28::steps.first.operation: there is no operation '100%25'"
        in robomaker("validate", path).err
    )


def test_text_that_is_not_utf_8_is_refused(robomaker, tmp_path) -> None:
    path = tmp_path / "latin.yaml"
    path.write_bytes("name: Küche".encode("latin-1"))
    ended = robomaker("validate", path)
    assert ended.code == 2
    assert "latin.yaml:1:1: this is not UTF-8 text" in ended.err


def test_a_plan_shows_order_and_amounts(robomaker) -> None:
    lines = robomaker("plan", SPECS / "quickstart.yaml").out.splitlines()
    steps = [line.split() for line in lines if line[:3].strip().isdigit()]
    assert [words[1] for words in steps] == ["template", "worlds", "export", "drive"]
    assert lines[3].endswith("CreateWorldGenerationJob  after template  4 worlds: 2 floor plans, 2 × furnished")
    assert lines[5].endswith(
        "4 simulation jobs, one for each world, 2 at a time, at most 5 min each, at most 30 min for all"
    )


TRIALS = """\
version: 1
name: trials
steps:
  drive:
    operation: StartSimulationJobBatch
    input:
      createSimulationJobRequests:
        seeds: 3
        value:
          maxJobDurationInSeconds: 60
          robotApplications: [{application: scout, launchConfig: {}}]
          simulationApplications:
            - application: indoor-navigation
              launchConfig: {environmentVariables: {ROBOMAKER_SIM_TIME_LIMIT_S: "20"}}
              worldConfigs: [{world: "arn:aws:robomaker:us-east-1:000000000000:world/import-1/world-1"}]
          trials: {seeds: 2, axes: {noise: {kind: lidar_noise_std_m, values: [0.01, 0.02]}}}
"""


def test_a_plan_says_how_many_trials_each_job_has_and_all_together(robomaker, spec) -> None:
    told = robomaker("plan", spec(TRIALS)).out
    assert "3 simulation jobs, one for each seed, 4 trials each, at most 1 min each" in told
    assert "\nin sum 3 simulation jobs × 4 trials = 12 trials, at most 4 min of simulated time\n" in told

    # A limit that a trial varies, or that another simulation may ignore, is not known; jobs without trials have none.
    varied = TRIALS.replace("axes: {", 'axes: {ROBOMAKER_SIM_TIME_LIMIT_S: {kind: variable, values: ["9", "99"]}, ')
    assert "× 8 trials = 24 trials\n" in robomaker("plan", spec(varied)).out
    assert "= 12 trials\n" in robomaker("plan", spec(TRIALS.replace("indoor-navigation", "arena"))).out
    single = TRIALS.replace(TRIALS.splitlines()[-1], "")
    assert "in sum 3 simulation jobs, at most 1 min of simulated time\n" in robomaker("plan", spec(single)).out


def test_a_plan_as_json(robomaker) -> None:
    document = json.loads(robomaker("plan", SPECS / "nightly.yaml", "-o", "json").out)
    by_name = {step["step"]: step for step in document["steps"]}
    assert by_name["houses"]["worlds"] == 10
    assert by_name["drive"]["jobs"] == 20
    assert by_name["drive"]["needs"] == ["flats", "houses"]


def test_a_plan_shows_the_limits_of_jobs_and_of_their_batch(robomaker, spec) -> None:
    path = spec("""\
version: 1
name: limits
steps:
  drive:
    operation: StartSimulationJobBatch
    input:
      batchPolicy: {timeoutInSeconds: 7200}
      createSimulationJobRequests:
        - maxJobDurationInSeconds: 60
          robotApplications: [{application: scout, launchConfig: {command: [./drive]}}]
        - maxJobDurationInSeconds: 300
          robotApplications: [{application: scout, launchConfig: {command: [./drive]}}]
  last:
    operation: CreateSimulationJob
    input:
      iamRole: arn:aws:iam::000000000000:role/local
      maxJobDurationInSeconds: 90
      robotApplications: [{application: scout, launchConfig: {command: [./drive]}}]
""")
    ended = robomaker("plan", path)
    assert "2 simulation jobs, at most 1 min to 5 min each, at most 2 h for all\n" in ended.out
    assert "1 simulation job, at most 1 min 30 s each\n" in ended.out
    steps = json.loads(robomaker("plan", path, "-o", "json").out)["steps"]
    limits = [(step["job_limit_s"], step["timeout_s"]) for step in steps]
    assert limits == [(300, 7200), (90, None)]


def test_amounts_that_only_a_run_can_tell_are_not_guessed(robomaker, spec) -> None:
    path = spec("""\
version: 1
name: many
steps:
  worlds: {operation: ListWorlds}
  drive:
    operation: StartSimulationJobBatch
    input:
      createSimulationJobRequests:
        forEach: ${{ worlds.worldSummaries }}
        as: world
        value:
          maxJobDurationInSeconds: 90
          simulationApplications:
            - {application: indoor-navigation, launchConfig: {}, worldConfigs: [{world: "${{ world.arn }}"}]}
""")
    ended = robomaker("plan", path)
    assert "a simulation job for each of ${{ worlds.worldSummaries }}, at most 1 min 30 s each" in ended.out
    assert json.loads(robomaker("plan", path, "-o", "json").out)["steps"][1]["jobs"] is None


WORLDS = """\
version: 1
name: flats
steps:
  worlds:
    operation: CreateWorldGenerationJob
    input: {template: "arn:t", worldCount: {floorplanCount: 20, interiorCountPerFloorplan: 1}}
  drive:
    operation: StartSimulationJobBatch
    input:
      createSimulationJobRequests:
        forEach: "${{ worlds.finishedWorldsSummary.succeededWorlds }}"
        value:
          maxJobDurationInSeconds: 90
          trials: {seeds: 10}
          simulationApplications:
            - {application: indoor-navigation, launchConfig: {}, worldConfigs: [{world: "WORLD"}]}
"""


@pytest.mark.parametrize(
    ("world", "test"),
    [
        ("${{ item }}", "the test that flips whole worlds"),
        ("${{ worlds.finishedWorldsSummary.succeededWorlds[0] }}", "the exact McNemar test"),
    ],
)
def test_a_plan_counts_worlds_where_they_have_several_trials(robomaker, spec, world: str, test: str) -> None:
    ended = robomaker("plan", spec(WORLDS.replace("WORLD", world)), "--detect", "10")
    assert f"decided by  {test}\n  a run has   200 trials" in ended.out
    assert ("in each world, as now" in ended.out) == ("worlds" in test)


SPEEDS = """\
version: 1
name: speeds
steps:
  drive:
    operation: StartSimulationJobBatch
    input:
      createSimulationJobRequests:
        axes:
          speed: {values: ["0.3", "0.6"]}
          world: {values: ["arn:1", "arn:2", "arn:3"]}
          ANOTHER
        seeds: SEEDS
        value:
          maxJobDurationInSeconds: 90
          simulationApplications:
            - application: indoor-navigation
              launchConfig: {environmentVariables: {SPEED: "${{ speed }}", MARGIN: "MARGIN_VALUE"}}
              worldConfigs: [{world: "${{ world }}"}]
"""


@pytest.mark.parametrize(
    ("another", "seeds", "lines"),
    [
        ("", 1, ["drive.speed: 3 pairs; no difference of its values can be shown; 6 is the least"]),
        (
            'margin: {values: ["0.28", "0.19"]}',
            1,
            [
                "drive.speed: 6 pairs; no difference of its values can be shown; 7 is the least",
                "drive.margin: 6 pairs; no difference of its values can be shown; 7 is the least",
            ],
        ),
        ("", 2, ["drive.speed: 6 pairs; a difference of its values can be shown; 6 is the least"]),
    ],
)
def test_a_plan_says_whether_values_of_an_axis_can_be_told_apart(
    robomaker, spec, another: str, seeds: int, lines: list[str]
) -> None:
    text = SPEEDS.replace("ANOTHER", another).replace("SEEDS", str(seeds))
    text = text.replace("MARGIN_VALUE", "${{ margin }}" if another else "0.28")
    path = spec(text)
    out = robomaker("plan", path, "--detect", "10").out
    assert [line.strip() for line in out.splitlines() if "of its values" in line] == lines
    axes = json.loads(robomaker("plan", path, "--detect", "10", "-o", "json").out)["axes"]
    assert [each["axis"] for each in axes] == ["speed", "margin"][: len(lines)]


def test_a_plan_shows_no_difference_larger_than_the_share_of_pairs_that_differ(robomaker, spec) -> None:
    path = spec(SPEEDS.replace("ANOTHER", "").replace("SEEDS", "1").replace("MARGIN_VALUE", "0.28"))
    out = robomaker("plan", path, "--detect", "10").out
    assert "they        show no difference where 20% of pairs differ; they would where 96.4% differ, all the" in out
    for differ in ((), ("--differ", "20")):
        out = robomaker("plan", path, "--detect", "20points", *differ).out
        assert re.search("assumed: 20% of pairs differ.*; all of them go the same way\n", out)


def way_to_more(out: str) -> str:
    [line] = re.findall(r"too few\n  to get them (.*)\n", out)
    return line


def test_a_plan_says_which_number_of_the_file_gives_enough_trials(robomaker, spec) -> None:
    path = spec(SPEEDS.replace("ANOTHER", "").replace("SEEDS", "2").replace("MARGIN_VALUE", "0.28"))
    assert way_to_more(robomaker("plan", path, "--detect", "10").out) == "drive.seeds 28 instead of 2"

    trials = SPEEDS.replace("value:\n", "value:\n          trials: {seeds: 4}\n")
    several = spec(trials.replace("ANOTHER", "").replace("SEEDS", "1").replace("MARGIN_VALUE", "0.28"))
    out = robomaker("plan", several, "--detect", "10").out
    assert way_to_more(out) == "drive.seeds 7 instead of 1, or drive.trials.seeds 28 instead of 4"

    quickstart = robomaker("plan", SPECS / "quickstart.yaml", "--detect", "10").out
    assert way_to_more(quickstart) == "worlds.floorplanCount 84 instead of 2 (with ROBOMAKER_MAX_WORLDS_PER_JOB=168)"
    assert "to get them" not in robomaker("plan", path, "--detect", "95").out, "it has enough"


def test_a_plan_names_no_number_that_gives_no_more_worlds_where_worlds_decide(robomaker, spec) -> None:
    """More seeds in the same worlds would answer nothing."""
    path = spec(WORLDS.replace("WORLD", "${{ item }}"))
    out = robomaker("plan", path, "--detect", "5").out
    assert "the test that flips whole worlds" in out
    way = r"worlds\.floorplanCount ([0-9]+) instead of [0-9]+ \(with ROBOMAKER_MAX_WORLDS_PER_JOB=\1\)"
    assert re.fullmatch(way, way_to_more(out))


def test_a_plan_says_how_many_trials_answer_a_question(robomaker, spec) -> None:
    """Trials of all jobs are counted; a job without trials is one."""
    path = spec("""\
version: 1
name: often
steps:
  drive:
    operation: StartSimulationJobBatch
    input:
      createSimulationJobRequests:
        forEach: [1, 2, 3, 4]
        value:
          maxJobDurationInSeconds: 90
          trials: {seeds: 50}
          simulationApplications:
            - application: indoor-navigation
              launchConfig: {}
              worldConfigs: [{world: "arn:aws:robomaker:us-east-1:000000000000:world/import-1/world-1"}]
""")
    ended = robomaker("plan", path, "--detect", "10points", "--margin", "10")
    assert (
        "to show a difference of 10 points with a chance of 80%: 168 trials in each of two runs\n"
        "  decided by  the exact McNemar test\n"
        "  a run has   200 trials: enough\n" in ended.out
    )
    assert (
        "to show that nothing got worse by 10 points with a chance of 80%: 165 trials in each of two runs" in ended.out
    )
    assert "assumed: 20% of pairs differ" in ended.out
    [first, second] = json.loads(robomaker("plan", path, "--detect", "5", "--margin", "5", "-o", "json").out)["needed"]
    assert (first["pairs"], first["more"], first["planned"], first["basis"]) == (658, 458, 200, "asked for")
    assert (second["pairs"], second["basis"]) == (639, "margin")
    beside = robomaker("plan", path, "--detect", "10points", "--against").out
    assert "241 trials in each of two runs\n  decided by  the evidence of `run --against`\n" in beside
    assert "  stops       after 136 trials or fewer in half of the runs\n  a run has   200 trials: 41 too few" in beside
    kept = robomaker("plan", path, "--margin", "20", "--against").out
    assert "that nothing got worse by 20 points with a chance of 80%: 81 trials in each of two runs\n" in kept
    assert "  decided by  the evidence of `run --against`\n  stops       after 46 trials or fewer" in kept
    quickstart = robomaker("plan", SPECS / "quickstart.yaml", "--detect", "10", "--differ", "14").out
    assert "114 trials in each of two runs" in quickstart
    assert "a run has   4 trials: 110 too few" in quickstart


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--machines", "2"), "--machines is for --probe; add that, or leave it out"),
        (("--price-per-hour", "0.5"), "--price-per-hour is for --probe"),
        (("--backend", "local"), "--backend is for --probe"),
        (("--probe", "--reuse"), "--probe forecasts a run that takes nothing over; leave --reuse out"),
        (("--probe", "--machines", "0"), "--machines is 0; a number from 1 would be right"),
        (("--probe", "--machines", "2"), "--machines is 2, but the backend is local"),
        (("--probe", "--price-per-hour", "-1"), "--price-per-hour is -1"),
        (("--alpha", "0.1"), "--alpha is for --detect and --margin; add one, or leave it out"),
        (("--differ", "10"), "--differ is for --detect and --margin"),
        (("--against",), "--against is for --detect and --margin; add one, or leave it out"),
        (("--detect", "0"), "--detect is '0'; a number above 0 and at most 100, such as 5, would be right"),
        (("--margin", "ten"), "--margin is 'ten'; a number above 0 and below 100"),
        (("--detect", "10", "--differ", "5"), "pass rates cannot differ by more than the share of trials that differ"),
        (("--detect", "10", "--alpha", "1"), "--alpha is 1; it has to be above 0 and below 1"),
        (("--probe", "--backend", "slurm"), "ROBOMAKER_BACKEND is 'slurm'"),
    ],
)
def test_what_cannot_be_forecast_starts_nothing(robomaker, home: Path, options: tuple[str, ...], said: str) -> None:
    ended = robomaker("plan", SPECS / "quickstart.yaml", *options)
    assert ended.code == 2
    assert said in ended.err
    assert not home.exists()


def test_a_probe_does_not_change_what_is_there(robomaker, spec, home: Path) -> None:
    path = spec("""\
version: 1
name: stops
steps:
  jobs: {operation: ListSimulationJobs}
  stop:
    operation: CancelSimulationJob
    input: {job: "${{ jobs.simulationJobSummaries[0].arn }}"}
""")
    ended = robomaker("plan", path, "--probe")
    assert ended.code == 2
    assert "steps.stop.input: CancelSimulationJob changes what is there already" in ended.err
    assert not home.exists()


NAMED = "version: 1\nname: named\nsteps:\n  look: {operation: DescribeWorld, input: {world: flat 2}}\n"


def test_worlds_may_be_named_as_the_command_line_names_them(robomaker, spec, service: Service) -> None:
    for number in (1, 2):
        world_id = f"generation-82856b0yq33y/world-{number}"
        labels = name_label(f"flat {number}")
        document = {"templateName": "flat", "bundle": {"bucket": "b", "prefix": f"worlds/{number}"}}
        world = Resource.new(
            arn=service.arn("world", world_id), kind="world", id=world_id, labels=labels, document=document
        )
        service.catalog.create(world, token=None)
    for name in ("flat 2", "generation-82856b0yq33y/world-2", "8285/world-2"):
        assert robomaker("validate", spec(NAMED.replace("flat 2", name))).code == 0
        assert robomaker("plan", spec(NAMED.replace("flat 2", name))).code == 0
    for command in ("validate", "plan"):
        path = spec(NAMED.replace("flat 2", "flat 3"))
        told = robomaker(command, path)
        assert told.code == 2
        assert f"{path}:4:51: steps.look.input.world: 'flat 3' is neither ARN" in told.err
        assert "did you mean 'flat 2' or 'flat 1'?" in told.err
    assert "may be any of 2 worlds" in robomaker("validate", spec(NAMED.replace("flat 2", "generation-8285"))).err


def test_problems_of_a_file_are_told_though_the_catalog_does_not_answer(
    robomaker, spec, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = TRIALS.replace("maxJobDurationInSeconds", "maxJobDuration")
    monkeypatch.setenv("ROBOMAKER_CATALOG_URL", "sqlite:////proc/none/catalog.db")
    ended = robomaker(
        "validate", spec(text.replace("arn:aws:robomaker:us-east-1:000000000000:world/import-1/world-1", "flat 3"))
    )
    assert ended.code == 2
    assert "maxJobDuration" in ended.err
