"""What the digest of states and checkpoints cost; prints figures and asserts no time.

The digest is compared with bare physics: steps of a furnished flat, 25 a call as jobs do, with and without the digest
looking when it is due. Checkpoints are compared with the job they are made in: navigation with recording, every 5 s of
simulated time, or less often where that would take more than a hundredth of the time; only the first is made in any
case. All is CPU time of one run; the two ways take turns, and of each lap the best counts.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import os
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.paths import REPOSITORY
from helpers.stop_flags import StopFlag
from ruamel.yaml import YAML

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.world_with_robot import assemble
from prefect_robomaker.tasks.runtime.applications.scout.agent import make_agent
from prefect_robomaker.tasks.runtime.episode.context import SimulationContext
from prefect_robomaker.tasks.runtime.process.observers import make_observers
from prefect_robomaker.tasks.runtime.process.run_loop import run_episode
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder
from prefect_robomaker.tasks.runtime.states.checkpoints import Checkpointer, LoopState, RunParts
from prefect_robomaker.tasks.runtime.states.provenance import ProvenanceRecorder
from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world, write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

QUICKSTART = REPOSITORY / "deployments" / "specs" / "quickstart.yaml"
ROUNDS, LAPS, LAP_STEPS, SUBSTEPS = 8, 10, 40, 25


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    specification = YAML(typ="safe").load(QUICKSTART.read_text())
    template = WorldTemplateBody.model_validate(specification["steps"]["template"]["input"]["templateBody"])
    folder = tmp_path_factory.mktemp("worlds") / "flat"
    write_bundle(generate_world(template, *seeds_for(7, 0, 0)), folder)
    return folder


def plan_in(folder: Path, world: Path, **members: Any) -> RunPlan:
    (folder / "out").mkdir(parents=True)
    return RunPlan(
        job_id="sim-1", job_arn="arn", run_id="run-1", seed=1, max_duration_s=600.0, world_dir=world,
        work_dir=folder, output_dir=folder / "out", **members,
    )  # fmt: skip


def physics_laps(world: Path, keeper: ProvenanceRecorder | None) -> list[float]:
    """CPU seconds of laps of physics from the same state, with the digest or without."""
    physics = assemble(world / "world.xml")
    model, data = physics.model.ptr, physics.data.ptr
    environment = SimpleNamespace(physics=physics)
    if keeper is not None:
        keeper.watch(environment, data.time)  # what happens once, at the beginning
    laps = []
    for _ in range(LAPS):
        began = time.process_time()
        for _ in range(LAP_STEPS):
            mujoco.mj_step(model, data, SUBSTEPS)
            if keeper is not None and data.time >= keeper.next_time_s - 5e-7:
                keeper.watch(environment, data.time)
        laps.append(time.process_time() - began)
    return laps


@pytest.mark.benchmark
def test_digest_against_physics(world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bare, watched = [], []
    for number in range(ROUNDS):
        bare.append(physics_laps(world, None))
        watched.append(physics_laps(world, ProvenanceRecorder(plan_in(tmp_path / str(number), world))))
    alone, both = (1e6 * np.min(laps, axis=0).sum() / (LAPS * LAP_STEPS) for laps in (bare, watched))
    with capsys.disabled():
        print(
            f"\ndigest: {alone:.1f} us per {SUBSTEPS} steps without, {both:.1f} with: {100 * (both / alone - 1):.2f} %"
            f" of step time; load {os.getloadavg()[0]:.1f}"
        )


class TimedCheckpointer(Checkpointer):
    """Takes the CPU time of what it does."""

    spent_s = 0.0
    made = 0

    def save(self, parts: RunParts, loop: LoopState) -> None:
        began = time.process_time()
        super().save(parts, loop)
        self.spent_s += time.process_time() - began
        self.made += 1


def run_job(folder: Path, world: Path, *, checkpoints: bool) -> tuple[float, float, int, float]:
    """CPU seconds of a job's episode, of these in checkpoints, how many, and the simulated seconds."""
    plan = plan_in(folder, world, checkpoint_dir=folder / "checkpoints")
    rng, recorder = np.random.default_rng(1), McapRecorder(folder / "out" / "recording.mcap")
    context = SimulationContext(
        plan=plan, rng=rng, world=read_world(world), world_dir=world, data_dir=None,
        output_dir=plan.output_dir, environment={}, recorder=recorder,
    )  # fmt: skip
    checkpointer = TimedCheckpointer(plan, rng) if checkpoints else None
    environment = make_environment(context)
    agent = make_agent(context, environment)
    began = time.process_time()
    episode = run_episode(
        lambda: environment,
        lambda environment: agent,
        mark=lambda phase: None,
        stop=StopFlag(),
        recorder=recorder,
        watchers=make_observers(plan, None),
        checkpoints=checkpointer,
    )
    took_s = time.process_time() - began
    recorder.close()
    if checkpointer is None:
        return took_s, 0.0, 0, episode.sim_time_s
    checkpointer.close()
    return took_s, checkpointer.spent_s, checkpointer.made, episode.sim_time_s


@pytest.mark.benchmark
def test_checkpoints_against_the_job(world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    without, kept = [], []
    for number in range(ROUNDS):
        without.append(run_job(tmp_path / f"a{number}", world, checkpoints=False))
        kept.append(run_job(tmp_path / f"b{number}", world, checkpoints=True))
    best, best_kept = min(without), min(kept)
    each_ms = [1e3 * spent_s / made for _, spent_s, made, _ in kept if made]
    per_checkpoint = f"{min(each_ms):.2f} ms each" if each_ms else "it is over before the first is due"
    share = sum(spent_s for _, spent_s, _, _ in kept) / sum(took_s for took_s, _, _, _ in kept)
    with capsys.disabled():
        print(
            f"\ncheckpoints: {sum(run[2] for run in kept) / ROUNDS:.1f} in {best[3]:.0f} s of navigation;"
            f" {1e3 * best[0]:.0f} ms CPU without,"
            f" {1e3 * best_kept[0]:.0f} with: {100 * (best_kept[0] / best[0] - 1):+.2f} %;"
            f" {per_checkpoint}, {100 * share:.2f} % of the run; load {os.getloadavg()[0]:.1f}"
        )
