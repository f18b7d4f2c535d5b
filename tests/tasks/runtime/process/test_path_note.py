"""The path of a run that goes on, as its process notes it."""

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import pytest
from helpers.paths import BUNDLES

from prefect_robomaker.schemas.runs.plan import ApplicationPlan
from prefect_robomaker.schemas.runs.programs import ApplicationRole
from prefect_robomaker.tasks.runtime.episode.progress import PATH_FILE, line_of, points_of
from prefect_robomaker.tasks.runtime.process.observers import PathNote
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

FILMED = BUNDLES / "filmed"
BALL = "<mujoco><worldbody><body pos='{x} 2 1'><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


class Drive:
    """Steps a run by hand: its robot goes one metre along x in each simulated second."""

    def __init__(self, folder: Path, model: str = BALL.format(x=0)) -> None:
        self.physics = SimpleNamespace(model=mujoco.MjModel.from_xml_string(model))
        self.physics.data = mujoco.MjData(self.physics.model)
        self.now_s = 0.0
        self.path = folder / PATH_FILE
        self.note = PathNote(folder, lambda: self.now_s)

    def until(self, time_s: float) -> None:
        """Goes on, as the loop of a run does."""
        while self.note.next_time_s <= time_s:
            if self.physics.model.nq:
                self.physics.data.qpos[0] = self.note.next_time_s
            mujoco.mj_forward(self.physics.model, self.physics.data)
            self.note.watch(self, self.note.next_time_s)

    @property
    def points(self) -> list[tuple[float, float, float]]:
        return points_of(self.path.read_text()) if self.path.exists() else []


def test_it_is_written_at_most_twice_a_second(tmp_path: Path) -> None:
    drive = Drive(tmp_path)
    drive.until(30)
    assert drive.points == []  # no time has passed
    drive.now_s = 0.5
    drive.until(30.5)
    first = drive.points
    assert first[:2] == [(0, 0, 2), (0.5, 0.5, 2)]
    assert first[-1] == (30.5, 30.5, 2)
    drive.now_s = 0.9
    drive.until(40)
    assert drive.points == first
    drive.now_s = 1.0
    drive.until(41)
    assert drive.points[-1] == (40.5, 40.5, 2)


def test_a_long_run_is_noted_less_often(tmp_path: Path) -> None:
    drive = Drive(tmp_path)
    drive.now_s = math.inf
    drive.until(36_000)
    assert drive.points[-1][0] > 35_000
    assert drive.path.stat().st_size < 300_000


def test_what_does_not_move_or_cannot_be_written_is_no_failure(tmp_path: Path) -> None:
    still = Drive(tmp_path, "<mujoco/>")
    still.now_s = 1
    still.until(5)
    assert not still.path.exists()
    (tmp_path / "elsewhere").touch()
    linked = Drive(tmp_path)
    linked.path.symlink_to(tmp_path / "elsewhere")
    linked.now_s = 1
    linked.until(5)
    assert (tmp_path / "elsewhere").read_text() == ""
    assert linked.note.next_time_s == math.inf


def test_moments_after_a_checkpoint_take_the_place_of_those_before() -> None:
    first = [(0.0, 0, 0), (1.0, 1, 0), (2.0, 2, 0), (3.0, 3, 0)]
    again = [(2.0, 2, 1), (3.0, 3, 1)]
    assert points_of("".join(map(line_of, [*first, *again]))) == [*first[:2], *again]


@pytest.mark.parametrize("odd", ["1,2", "a,b,c\n", "nan,1,1\n", "1,inf,1\n", "1,2,3,4\n", "\x00\n", "7,1,1"])
def test_what_is_no_moment_is_left_out(odd: str) -> None:
    assert points_of("0,1,2\n" + odd) == [(0, 1, 2)]


def test_a_run_notes_its_path_and_is_the_same(launcher: Launcher, make_plan: Any, make_context: Any) -> None:
    flat = make_context().plan.world_dir

    def planned(role: ApplicationRole, name: str, **variables: str) -> ApplicationPlan:
        attribute = f"filmed.arena.{name}"
        return ApplicationPlan(role=role, name=name, attribute=attribute, path=FILMED, environment_variables=variables)

    arena = planned("simulation", "make_environment", END_S="3", PAUSE_S="0.01")
    plans = [
        make_plan(
            simulation_application=arena, robot_application=planned("robot", "make_agent"), run_id=name, world_dir=world
        )
        for name, world in (("noted", flat), ("alone", None))
    ]
    assert [launcher.run(plan, lambda: None).status for plan in plans] == ["Completed"] * 2
    noted, alone = (json.loads((plan.output_dir / "result.json").read_text()) for plan in plans)
    assert len(points_of((plans[0].work_dir / PATH_FILE).read_text())) >= 2
    assert not (plans[1].work_dir / PATH_FILE).exists()
    assert noted["state_digest"] == alone["state_digest"] is not None
