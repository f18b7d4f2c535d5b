"""Requirements about topics: by recordings as nodes leave them, and of runs with a simulation."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.yard_sabotages import YARD
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan, RunResult
from prefect_robomaker.schemas.runs.requirements import parse_requirements
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.tasks.runtime.process.judging import judge
from prefect_robomaker.tasks.runtime.process.judging_request import JudgingRequest
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

STORE = get_typestore(Stores.LATEST)
TYPES = STORE.types
STAMP = TYPES["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
START_NS = 1_700_000_000_000_000_000
Said = tuple[float, str, Any]


def number(time_s: float, value: float, topic: str = "/charge") -> Said:
    return time_s, topic, TYPES["std_msgs/msg/Float64"](data=value)


def line(time_s: float, name: str, level: int) -> Said:
    words = {"msg": f"{name} speaks", "file": "", "function": "", "line": 1}
    return time_s, "/rosout", TYPES["rcl_interfaces/msg/Log"](stamp=STAMP, level=level, name=name, **words)


@pytest.fixture
def judged(tmp_path: Path) -> Callable[..., RunResult]:
    """Judges messages that were received so many seconds after the first one."""
    folders = iter(range(100))

    def run(said: list[Said], *asked: dict[str, Any], **of_request: Any) -> RunResult:
        folder = tmp_path / f"bag-{next(folders)}"
        with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            connections: dict[str, Any] = {}
            for time_s, topic, message in sorted(said, key=lambda each: each[0]):
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
                data = STORE.serialize_cdr(message, kind)
                writer.write(connections[topic], START_NS + round(time_s * 1e9), data)
        requirements = [
            {"kind": "topic", "name": f"it-{i}", "topic": "/charge", **each} for i, each in enumerate(asked)
        ]
        plan = RunPlan(
            job_id="sim-1", job_arn="arn:aws:robomaker:us-east-1:111122223333:simulation-job/sim-1", run_id="run-1",
            seed=1, max_duration_s=60.0, work_dir=tmp_path, output_dir=tmp_path,
            requirements=parse_requirements(requirements, "asked"),
        )  # fmt: skip
        return judge(JudgingRequest(plan=plan, recording=folder / f"{folder.name}.mcap", **of_request))

    return run


def test_of_topics_that_are_not_recorded_whole_silence_proves_nothing(judged: Callable[..., RunResult]) -> None:
    """The recorder had no more room, or died: the values and the errors that it missed are nowhere."""
    said = [number(i / 10, 1.0) for i in range(101)] + [number(i / 10, 1.0, "/seen") for i in range(101)]
    said += [line(1.0, "planner", 20), line(2.0, "driver", 40)]
    result = judged(
        said,
        {"field": "data", "max": 2},
        {"field": "data", "max": 0.5},
        {"min_hz": 5},
        {"topic": "/seen", "field": "data", "max": 2},
        {"topic": "/rosout", "nodes": ["planner"]},
        {"topic": "/rosout", "nodes": ["driver"]},
        losses={"/charge": "7 messages were left out", "/rosout": "its recorder was started 2 times"},
    )
    errors = [each.error for each in result.requirements]
    assert errors[0] == "/charge: 7 messages were left out, so something could have been missed"
    assert errors[4] == "/rosout: its recorder was started 2 times, so something could have been missed"
    others = [(each.error, each.satisfied) for i, each in enumerate(result.requirements) if i not in (0, 4)]
    assert others == [(None, False), (None, True), (None, True), (None, False)]
    assert result.verdict == "ERROR"
    late = judged(
        [*said, number(10.0, 3.0)], {"field": "data", "max": 2}, losses={"/charge": "7 messages were left out"}
    )
    assert late.verdict == "FAIL", late.requirements


STEADY = [number(0.1 * i, 1.0 - 0.005 * i) for i in range(101)]
"""Ten seconds at 10 Hz, from 1 to 0.5."""
ASKED = [
    {"min_hz": 9},
    {"max_gap_s": 0.5},
    {"field": "data", "min": 0.4, "max": 1.1},
    {"topic": "/rosout", "nodes": ["plan*"]},
]
CALM = [line(1.0, "planner", 20), line(2.0, "camera", 40)]


def test_who_is_spoilt_is_caught(judged: Callable[..., RunResult]) -> None:
    def missed(said: list[Said]) -> list[int]:
        result = judged(said, *ASKED)
        assert [item.error for item in result.requirements if item.error] == []
        assert result.verdict == ("PASS" if all(item.satisfied for item in result.requirements) else "FAIL")
        return [index for index, item in enumerate(result.requirements) if not item.satisfied]

    assert missed([*STEADY, *CALM]) == []
    assert missed([*STEADY[::2], STEADY[-1], *CALM]) == [0]
    assert missed([*STEADY[:40], *STEADY[46:], *[number(0.1 * i + 0.05, 0.7) for i in range(39)], *CALM]) == [1]
    assert missed([*STEADY, number(5.01, 0.3), *CALM]) == [2]
    assert missed([*STEADY, *CALM, line(3.0, "planner_server", 50)]) == [3]


def test_numbers_and_words(judged: Callable[..., RunResult]) -> None:
    said = [*STEADY[:50], *CALM, line(3.0, "planner", 40), number(10.0, 0.2)]
    rate, gap, charge, lines = judged(said, *ASKED).requirements

    assert (rate.value, rate.limit, rate.unit, rate.margin) == (5.1, 9.0, "Hz", pytest.approx(-3.9))
    assert rate.detail == "51 messages on /charge, 5.10 Hz, 9 Hz asked for"
    assert (gap.value, gap.unit, gap.margin) == (pytest.approx(5.1), "s", pytest.approx(-4.6))
    assert gap.first_violation_s == pytest.approx(10.0)
    assert (charge.value, charge.limit, charge.margin) == (0.2, 0.4, pytest.approx(-0.2))
    assert charge.detail == "data on /charge from 0.2 to 1, at least 0.4 asked for, first at 10.00 s"
    assert lines.detail == "1 lines at ERROR on /rosout, 0 allowed, first at 3.00 s: planner: planner speaks"
    assert (lines.value, lines.margin, lines.unit) == (1.0, -1.0, "errors")


def test_silence_at_the_end_is_a_gap(judged: Callable[..., RunResult]) -> None:
    result = judged([number(0.0, 1.0), number(9.0, 1.0, "/other")], {"max_gap_s": 1})
    assert result.requirements[0].value == pytest.approx(9.0)
    assert result.verdict == "FAIL"


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"topic": "/chargee", "min_hz": 1}, "has no topic /chargee; did you mean '/charge'?"),
        ({"field": "datum", "max": 1}, "a message on /charge has no field datum; there are data"),
        ({"topic": "/rosout", "nodes": ["planer"]}, "no line of planer came on /rosout"),
        ({"nodes": ["planner"]}, "messages on /charge are no lines of a log; /rosout would be right"),
        ({"topic": "/rosout", "field": "msg", "max": 1}, "msg on /rosout is planner speaks at 1.00 s, which is no"),
    ],
)
def test_what_was_not_recorded_is_an_error(judged: Callable[..., RunResult], asked: dict[str, Any], words: str) -> None:
    """Silence must not pass for the absence of errors."""
    result = judged([*STEADY, *CALM], asked)
    assert result.verdict == "ERROR"
    assert words in (result.requirements[0].error or "")


def test_a_topic_that_said_nothing_has_no_gaps_in_a_short_run() -> None:
    (asked,) = parse_requirements([{"kind": "topic", "name": "it", "topic": "/charge", "max_gap_s": 5}], "asked")
    assert "no message came on /charge" in (asked.rule(asked).judged(4.0, "environment").error or "")
    assert asked.rule(asked).judged(6.0, "environment").satisfied is False


# Runs with a simulation


@pytest.fixture
def drive(launcher: Launcher, make_plan: Callable[..., RunPlan]) -> Callable[..., RunResult]:
    def run(*asked: dict[str, Any], **members: Any) -> RunResult:
        simulation, robot = (
            ApplicationPlan(role=role, name=role, attribute=f"yard.{attribute}", path=YARD)  # pyright: ignore[reportArgumentType]
            for role, attribute in (("simulation", "make_environment"), ("robot", "make_agent"))
        )
        plan = make_plan(
            simulation_application=simulation, robot_application=robot,
            requirements=parse_requirements(list(asked), "asked"), **members,
        )  # fmt: skip
        assert launcher.run(plan, lambda: None).status == "Completed"
        return RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())

    return run


EAST = {"kind": "goal", "name": "east", "x": 1.2, "y": 0.5, "within_m": 0.2}
FAR = {"kind": "topic", "name": "far", "topic": "/joint_states", "field": "position", "max": 0.9}
OFTEN = {"kind": "topic", "name": "often", "topic": "/joint_states", "min_hz": 5}


def test_a_simulations_own_topics_are_judged_when_it_is_over(drive: Callable[..., RunResult]) -> None:
    passed = drive(EAST, OFTEN)
    assert (passed.verdict, passed.reason) == ("PASS", None)
    assert [(item.name, item.satisfied) for item in passed.requirements] == [("east", True), ("often", True)]
    assert "verdict_without_topics" not in passed.extra


def test_a_topic_out_of_its_range_fails_a_run_that_reached_its_goal(drive: Callable[..., RunResult]) -> None:
    failed = drive(EAST, FAR)
    assert failed.verdict == "FAIL"
    (far,) = [item for item in failed.requirements if item.name == "far"]
    assert far.margin is not None
    assert far.margin == pytest.approx(-0.3, abs=0.02)
    assert "could not be judged" not in failed.summary


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({"record": False}, "the run recorded no topics; set loggingConfig.recordAllRosTopics"),
        ({"trials": Trials(seeds=2)}, ""),
    ],
)
def test_without_a_recording_of_the_run_nothing_passes(
    drive: Callable[..., RunResult], members: dict[str, Any], words: str
) -> None:
    result = drive(EAST, OFTEN, **members)
    assert result.verdict == "ERROR"
    assert words in (result.reason or "")
