"""Requirements about how and where a robot moves, in a flat with a map: a robot that is led along a way."""

import itertools
import math
import pickle
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import dm_env
import mujoco
import numpy as np
import pytest
from helpers.hand_written_flat import describe_world, write_map
from helpers.stop_flags import StopFlag

from prefect_robomaker.schemas.runs.plan import RunPlan, RunResult
from prefect_robomaker.schemas.runs.requirement_kinds import expression
from prefect_robomaker.schemas.runs.requirement_kinds.kind import RequirementError
from prefect_robomaker.tasks.runtime.episode.floor import MapFloor
from prefect_robomaker.tasks.runtime.episode.occupancy_map import read_map
from prefect_robomaker.tasks.runtime.episode.run_results import make_result
from prefect_robomaker.tasks.runtime.process.run_loop import run_episode
from prefect_robomaker.tasks.runtime.recording.recording import Recorder
from prefect_robomaker.tasks.runtime.requirements.observer import RequirementsObserver

MODEL = """
<mujoco><option gravity="0 0 0"/><worldbody>
  <geom name="floor" type="plane" size="9 9 .1"/>
  <geom name="pillar" type="box" size=".1 .1 .5" pos="2 -.6 .5"/>
  <body name="robot" pos="0 0 .3"><{joint}/><geom size=".1"/></body>
</worldbody></mujoco>
"""
STEP_S = 0.05
TOUR = [(0, 0), (0.45, 0), (0.45, 2), (0.45, 0), (4.45, 0), (4.45, 2)]
"""A way from the hall into the living room and the kitchen."""


class Led(dm_env.Environment):
    """A robot that is led along a way, and falls over or does not move where it is told to."""

    robot_body = "robot"

    def __init__(self, way: Sequence[tuple[float, float]], speed_mps: float, falls: bool, rests_s: float, joint: str):
        model = mujoco.MjModel.from_xml_string(MODEL.format(joint=joint))
        self.physics = SimpleNamespace(model=model, data=mujoco.MjData(model))
        places = np.array(way, dtype=np.float64)
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(places, axis=0).T))))
        driven = np.arange(0.0, along[-1] + speed_mps * STEP_S, speed_mps * STEP_S)
        self._way = np.stack([np.interp(driven, along, places[:, axis]) for axis in (0, 1)], axis=1)
        self._way = np.concatenate((self._way, np.repeat(self._way[-1:], round(rests_s / STEP_S), axis=0)))
        self._falls, self._done = falls, 0

    def reset(self) -> dm_env.TimeStep:
        mujoco.mj_forward(self.physics.model, self.physics.data)
        return dm_env.restart({})

    def step(self, action: Any) -> dm_env.TimeStep:
        self._done += 1
        data = self.physics.data
        data.qpos[:2] = self._way[self._done]
        if self._falls and self._done == len(self._way) // 2:
            data.qpos[3:7] = (math.cos(0.4), math.sin(0.4), 0, 0)
        mujoco.mj_forward(self.physics.model, data)
        data.time = self._done * STEP_S
        return dm_env.termination(0.0, {}) if self._done + 1 >= len(self._way) else dm_env.transition(0.0, {})

    def observation_spec(self) -> Any:
        raise NotImplementedError

    action_spec = observation_spec


Judge = Callable[..., RunResult]


@pytest.fixture
def plan(tmp_path: Path) -> Callable[..., RunPlan]:
    """Plans a run in the flat."""
    world = tmp_path / "world"
    world.mkdir()
    (world / "world.json").write_text(describe_world([]).model_dump_json())
    write_map(world)

    def made(requirements: Sequence[Mapping[str, Any]], has_world: bool = True) -> RunPlan:
        return RunPlan.model_validate({
            "job_id": "sim-1", "job_arn": "arn:aws:robomaker:us-east-1:111122223333:simulation-job/sim-1",
            "run_id": "run-1", "seed": 1, "max_duration_s": 60.0, "work_dir": str(tmp_path),
            "output_dir": str(tmp_path), "world_dir": str(world) if has_world else None,
            "requirements": [{"name": f"it-{i}", **each} for i, each in enumerate(requirements)],
        }, strict=False)  # fmt: skip

    return made


@pytest.fixture
def judge(plan: Callable[..., RunPlan]) -> Judge:
    def run(
        *requirements: dict[str, Any], way: Sequence[tuple[float, float]] = TOUR, speed_mps: float = 1.0,
        falls: bool = False, rests_s: float = 0.0, has_world: bool = True, joint: str = "freejoint",
    ) -> RunResult:  # fmt: skip
        observer = RequirementsObserver(plan(requirements, has_world))
        episode = run_episode(
            lambda: Led(way, speed_mps, falls, rests_s, joint), lambda environment: lambda timestep: np.zeros(0),
            mark=lambda phase: None, stop=StopFlag(), recorder=Recorder(), watchers=[observer],
            wall_clock=itertools.count(0.0, 1.0).__next__,
        )  # fmt: skip
        return make_result(episode, 1, [observer.close(episode.ended_by)])

    return run


RULES = """
import numpy as np
def estimate(environment, time_s):
    return environment.physics.data.qpos[:2] + [0.05, 0.0] if time_s > 1 else None
def drifting(environment, time_s):
    return environment.physics.data.qpos[:2] * 1.2
def charge(environment, time_s):
    return np.float64(1.0 - 0.05 * time_s)
def words(environment, time_s):
    return "much"
"""


@pytest.fixture
def rules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    name = f"rules_{tmp_path.name.replace('-', '_')}"
    (tmp_path / f"{name}.py").write_text(RULES)
    monkeypatch.syspath_prepend(str(tmp_path))
    return name


def test_who_is_spoilt_is_caught(judge: Judge, rules: str) -> None:
    """The unspoilt robot passes, and each kind catches what it is for."""
    asked: list[dict[str, Any]] = [
        {"kind": "speed", "name": "slow", "max_mps": 1.1},
        {"kind": "upright", "name": "stands", "max_tilt_deg": 30},
        {"kind": "coverage", "name": "swept", "room": "hall", "min_share": 0.25, "radius_m": 0.3},
        {"kind": "all_rooms", "name": "all"},
        {"kind": "localization", "name": "knows", "attribute": f"{rules}.estimate", "max_m": 0.1, "from_s": 1.1},
    ]
    drifting = [*asked[:4], {**asked[4], "attribute": f"{rules}.drifting", "from_s": 0}]

    def missed(*requirements: dict[str, Any], **members: Any) -> set[str]:
        result = judge(*requirements, **members)
        assert [item.error for item in result.requirements if item.error] == []
        assert result.verdict == ("FAIL" if any(not item.satisfied for item in result.requirements) else "PASS")
        return {item.name for item in result.requirements if not item.satisfied}

    assert missed(*asked) == set()
    assert missed(*asked, speed_mps=1.5) == {"slow"}
    assert missed(*asked, falls=True) == {"stands"}
    assert missed(*asked, way=[(0, 0), (0.001, 0)], rests_s=5) == {"swept", "all"}
    assert missed(*asked, way=TOUR[:4]) == {"swept", "all"}
    assert missed(*drifting) == {"knows"}


def test_numbers_of_all_kinds(judge: Judge, rules: str) -> None:
    result = judge(
        {"kind": "goal", "name": "kitchen", "room": "kitchen"},
        {"kind": "speed", "max_mps": 0.9, "room": "living"},
        {"kind": "path_length", "goal": "kitchen", "min_ratio": 0.9, "radius_m": 0.2},
        {"kind": "coverage", "min_share": 0.9, "radius_m": 0.2},
        {"kind": "all_rooms", "by_s": 3},
        {"kind": "progress", "max_stuck_s": 2},
        {"kind": "expression", "formula": "always (clearance < 0.5 -> speed < 0.5) and eventually charge < 0.9",
         "signals": {"charge": f"{rules}.charge"}},
        rests_s=3,
    )  # fmt: skip
    goal, speed, path, coverage, rooms, progress, formula = result.requirements

    assert goal.satisfied
    assert speed.detail.startswith("reached 1.00 m/s in living; at most 0.9 m/s is allowed, first at ")
    assert speed.margin == pytest.approx(-0.1, abs=1e-3)
    # Straight to the doorway of the kitchen it is 4.2 m; the tour took 0.45 + 2 + 2 + 4 + 1 m.
    assert path.value == pytest.approx(4.2 / 9.5, abs=0.02)
    assert coverage.value == pytest.approx((2 + 4.45 + 2) * 0.4 / 42.2, abs=0.01), "there and back is once"
    assert "of the free floor, 90 % asked for" in coverage.detail
    assert rooms.detail == "2 of 3 rooms visited, 3 s asked for; not kitchen"
    assert progress.value == pytest.approx(3.0, abs=0.15)
    assert (formula.satisfied, formula.error) == (False, None)
    assert formula.margin == pytest.approx(-0.1, abs=0.01), "it passes the pillar at 0.4 m with 1 m/s"
    assert {"max_speed_mps", "success_weighted_by_path_length", "way_to_goals_m", "floor_coverage",
            "visited_rooms_share", "longest_stuck_s"} <= result.metrics.keys()  # fmt: skip
    assert result.verdict == "FAIL"


@pytest.mark.parametrize(
    ("asked", "members", "words"),
    [
        ({"kind": "upright", "max_tilt_deg": 9}, {"joint": 'joint name="x" type="slide"'}, "no joint lets the robot's"),
        ({"kind": "upright", "max_tilt_deg": 9}, {"joint": 'joint name="x" axis="0 0 1"'}, "no joint lets the robot's"),
        ({"kind": "expression", "formula": "tilt < 9"}, {"joint": 'joint name="x" type="slide"'}, "no joint lets the"),
        ({"kind": "speed", "max_mps": 9, "room": "kitchen"}, {"way": TOUR[:3]}, "the robot was not seen in kitchen"),
        ({"kind": "coverage", "min_share": 0.001, "radius_m": 0.3}, {}, "covers so much where it starts"),
        ({"kind": "coverage", "min_share": 0.5, "radius_m": 9.0}, {}, "has no floor that a disc of 9 m can pass over"),
        ({"kind": "all_rooms", "ignore": ["living", "kitchen"]}, {}, "starts in the only room that counts"),
        ({"kind": "expression", "formula": "always[0, 60] speed < 9"}, {}, "before it was decided: the formula looks"),
        ({"kind": "expression", "formula": "clearance > 0", "ignore": ["pillar"]}, {}, "there is nothing that is not"),
    ],
)  # fmt: skip
def test_what_could_not_be_missed_is_an_error(
    judge: Judge, asked: dict[str, Any], members: dict[str, Any], words: str
) -> None:
    joint = members.get("joint")
    if joint:  # such a robot has fewer coordinates than are led
        members = {"joint": f'joint name="a" type="slide" axis="0 1 0"/><{joint}'}
    result = judge(asked, **members)
    assert result.verdict == "ERROR"
    assert words in (result.requirements[0].error or "")


def test_a_way_that_the_map_has_not(judge: Judge) -> None:
    goal = {"kind": "goal", "name": "east", "x": 4.5, "y": 2}
    way = {"kind": "path_length", "goal": "east", "min_ratio": 0.5}
    assert "no way to east for a radius of 0.6 m" in (judge(goal, {**way, "radius_m": 0.6}).requirements[1].error or "")
    start = judge({**goal, "x": 0.1, "y": 0.0, "by_s": 9}, way).requirements[1]
    assert "is reached already, so it could not be missed" in (start.error or "")


@pytest.mark.parametrize(
    ("asked", "has_world", "words"),
    [
        ({"kind": "coverage", "min_share": 0.5, "radius_m": 0.3}, False, "it asks for the floor of a world"),
        ({"kind": "all_rooms"}, False, "it asks for the rooms of a world, but there is no world"),
        ({"kind": "speed", "max_mps": 1, "room": "hal"}, True, "the world has no room 'hal'; did you mean 'hall'?"),
        ({"kind": "all_rooms", "ignore": ["attic"]}, True, "ignore is 'attic', which fits no room; there are hall"),
        ({"kind": "expression", "formula": "always a < 1", "signals": {"a": "no_such_9.f"}}, True, "no_such_9"),
        ({"kind": "localization", "attribute": "no_such_9.f", "max_m": 1}, True, "no installed package no_such_9"),
    ],
)
def test_what_cannot_be_judged_fails_the_job_at_once(
    judge: Judge, asked: dict[str, Any], has_world: bool, words: str
) -> None:
    with pytest.raises(RequirementError) as told:
        judge(asked, has_world=has_world)
    assert words in str(told.value)


def test_a_signal_that_is_no_number_is_an_error(judge: Judge, rules: str) -> None:
    asked = {"kind": "expression", "formula": "always a < 1", "signals": {"a": f"{rules}.words"}}
    assert judge(asked).requirements[0].error == f"{rules}.words returned much at 0.00 s; a number would be right"


def test_without_rtamt_a_formula_is_refused_with_the_command(judge: Judge, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(expression.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(RequirementError, match=r"rtamt, which judges formulas, is not installed: .*stl"):
        judge({"kind": "expression", "formula": "always speed < 1"})


def test_a_run_that_is_continued_is_judged_as_a_whole(plan: Callable[..., RunPlan]) -> None:
    """Half of the run is seen by one observer, half by another in another process."""
    asked = [
        {"kind": "goal", "name": "kitchen", "room": "kitchen"},
        {"kind": "speed", "max_mps": 1.01},
        {"kind": "path_length", "goal": "kitchen", "min_ratio": 0.4},
        {"kind": "coverage", "min_share": 0.1, "radius_m": 0.3},
        {"kind": "all_rooms"},
        {"kind": "progress", "max_stuck_s": 2},
        {"kind": "expression", "formula": "(x < 1 until y > 1.5) and eventually x > 4 and always speed < 1.01"},
    ]

    def whole(cut_at: int) -> list[Any]:
        led = Led(TOUR, 1.0, False, 0.0, "freejoint")
        led.reset()
        observer = RequirementsObserver(plan(asked))
        observer.watch(led, 0.0)
        while not led.step(None).last():
            time_s = led.physics.data.time
            if time_s >= observer.next_time_s - 1e-6:
                observer.watch(led, time_s)
            if led._done == cut_at:
                kept = pickle.dumps(observer.state())
                observer = RequirementsObserver(plan(asked))
                observer.restore(pickle.loads(kept), led)
        observer.last_look(led)
        return observer.close("environment").requirements

    assert [item.satisfied for item in whole(77)] == [True] * 7
    assert whole(77) == whole(0)


@pytest.mark.parametrize("radius_m", [0.0, 0.2])
def test_shortest_ways_are_as_long_as_straight_ones_where_nothing_is_between(tmp_path: Path, radius_m: float) -> None:
    """Longer ones would flatter a robot that takes detours."""
    write_map(tmp_path)
    floor = MapFloor(read_map(tmp_path / "map.yaml"))
    for end in ((2.0, 0.0), (5.0, 0.6), (-1.4, -0.7), (3.3, 0.55)):
        found = floor.shortest_m((0.0, 0.0), [end], radius_m)
        assert found == pytest.approx(math.hypot(*end), rel=1e-6)
    # Round the east jamb of the doorway at x = 0.9, y = 0.95 to 1.05, for a disc that keeps away from it.
    around = floor.shortest_m((2.0, 0.0), [(2.0, 2.0)], 0.0)
    assert around is not None
    assert around == pytest.approx(2 * math.hypot(1.1, 0.95) + 0.1, rel=0.03)
    assert floor.shortest_m((0.0, 0.0), [(9.0, 9.0)], 0.0) is None
    assert floor.shortest_m((0.0, 0.0), [(3.0, 1.0), (6.0, 1.0), (6.0, 5.0), (3.0, 5.0)], 0.0) == pytest.approx(
        math.hypot(0.9, 1.05) + math.hypot(2.1, 1.45), rel=0.03
    ), "through the living room it is shorter"
    straight = len(floor.passed((0.0, 0.0), (2.0, 0.0), 0.3)) * floor.cell_m2
    assert straight == pytest.approx(2 * 0.6 + math.pi * 0.09, rel=0.02)
