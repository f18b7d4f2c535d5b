"""What trials cost beside a bare loop of episodes, and how much memory many of them take; prints figures.

The bare loop makes environment and agent as trials do, and then only calls `agent` and `environment.step`: no digest,
no requirements, no rows. Both play the same seeds, in CPU time of one process; they take turns, and of each the best
round counts. Trials include all that a job's process does for them, up to the table.

Memory is that of a job's process, seen while it runs `ROBOMAKER_BENCH_TRIALS` trials (2,000 unless it says otherwise).
"""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.paths import BUNDLES, REPOSITORY
from helpers.processes import working_below
from helpers.stop_flags import StopFlag
from ruamel.yaml import YAML

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.episode.progress import Progress
from prefect_robomaker.tasks.runtime.process.attempt import applications_of, contexts_of, factory_of, read_world
from prefect_robomaker.tasks.runtime.process.run_request import RunRequest
from prefect_robomaker.tasks.runtime.process.trial_runs import renews, run_trials
from prefect_robomaker.tasks.runtime.recording.recording import Recorder
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

QUICKSTART = REPOSITORY / "deployments" / "specs" / "quickstart.yaml"
ROUNDS = 4


def swing(folder: Path, seconds: str, **members: Any) -> RunPlan:
    """Trials of the pendulum."""
    bundle = BUNDLES / "swinger"
    return RunPlan(
        job_id="sim-1", job_arn="arn", run_id="run-1", seed=1, max_duration_s=3600.0, record=False, **members,
        work_dir=folder / "work", output_dir=folder / "out",
        simulation_application=ApplicationPlan(
            role="simulation", name="swing", attribute="swinger.make_environment", path=bundle,
            environment_variables={"TIME_LIMIT_S": seconds},
        ),
        robot_application=ApplicationPlan(role="robot", name="pusher", attribute="swinger.make_agent", path=bundle),
    )  # fmt: skip


def scout(folder: Path, seconds: str, **members: Any) -> RunPlan:
    """Trials of Scout in the quickstart's flat."""
    world = folder / "world"
    if not world.exists():
        specification = YAML(typ="safe").load(QUICKSTART.read_text())
        body = WorldTemplateBody.model_validate(specification["steps"]["template"]["input"]["templateBody"])
        write_bundle(generate_world(body, *seeds_for(7, 0, 0)), world)
    return RunPlan(
        job_id="sim-1", job_arn="arn", run_id="run-1", seed=1, max_duration_s=3600.0, record=False, world_dir=world,
        work_dir=folder / "work", output_dir=folder / "out", **members,
        simulation_application=ApplicationPlan(
            role="simulation", name="indoor-navigation",
            attribute="prefect_robomaker.tasks.runtime.applications.indoor_navigation.make_environment",
            environment_variables={"ROBOMAKER_SIM_TIME_LIMIT_S": seconds},
        ),
    )  # fmt: skip


def bare_loop(plan: RunPlan, trials: Trials) -> int:
    """Plays the same episodes; returns how many steps they had."""
    make_environment, make_agent = map(factory_of, applications_of(plan))
    world, steps = read_world(plan.world_dir), 0
    environment: Any = None
    agent: Any = None
    for number in range(trials.count):
        rng = np.random.default_rng(trials.trial(number, plan.seed).seed)
        context, robot_context = contexts_of(plan, rng, world, Recorder())
        if renews(environment):
            environment.renew(context)
        else:
            environment = make_environment(context)
        if renews(agent):
            agent.renew(robot_context, environment)
        else:
            agent = make_agent(robot_context, environment)
        timestep = environment.reset()
        try:
            while not timestep.last():
                timestep = environment.step(agent(timestep))
                steps += 1
        except StopIteration:
            pass
    return steps


def in_a_job(plan: RunPlan, trials: Trials) -> None:
    for folder in (plan.work_dir, plan.output_dir):
        folder.mkdir(exist_ok=True)
    (plan.work_dir / "trials.jsonl").unlink(missing_ok=True)
    request = RunRequest(plan=plan.model_copy(update={"trials": trials}), environment=dict(os.environ), import_path=[])
    run_trials(request, Progress(), StopFlag())


def cpu_s(play: Callable[[RunPlan, Trials], object], plan: RunPlan, trials: Trials) -> float:
    began = time.process_time()
    play(plan, trials)
    return time.process_time() - began


@pytest.mark.benchmark
@pytest.mark.parametrize(
    ("make", "seconds", "count"),
    [(swing, "1", 600), (swing, "4", 200), (scout, "10", 10), (scout, "60", 4)],
    ids=["pendulum 1 s", "pendulum 4 s", "Scout 10 s", "Scout 60 s"],
)
def test_trials_against_a_bare_loop_of_episodes(
    make: Callable[..., RunPlan],
    seconds: str,
    count: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ROBOMAKER_SEED", "0")
    plan, trials = make(tmp_path, seconds), Trials(seeds=count, record_failed=0)
    in_a_job(plan, Trials(seeds=1, record_failed=0))  # imports
    bare, jobs = [], []
    for _ in range(ROUNDS):
        bare.append(cpu_s(bare_loop, plan, trials))
        jobs.append(cpu_s(in_a_job, plan, trials))
    with capfd.disabled():
        print(
            f"\n{make.__name__} {seconds} s: {1000 * min(bare) / count:.2f} ms a bare episode, "
            f"{1000 * min(jobs) / count:.2f} ms a trial: {min(bare) / min(jobs):.3f}; load {os.getloadavg()[0]:.1f}"
        )


def memory_mb(pid: int) -> tuple[float, float]:
    """Resident memory now, and the most there was."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    found = {name: int(value.split()[0]) / 1024 for name, _, value in (line.partition(":") for line in lines)
             if name in ("VmRSS", "VmHWM")}  # fmt: skip
    return found["VmRSS"], found["VmHWM"]


@pytest.mark.benchmark
@pytest.mark.timeout(3600)
def test_memory_of_many_trials(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    count = int(os.environ.get("ROBOMAKER_BENCH_TRIALS", "2000"))
    trials = Trials(seeds=count, record_failed=0)
    plan = swing(tmp_path, "0.2", trials=trials)
    journal = plan.work_dir / "trials.jsonl"
    seen: dict[int, tuple[float, float]] = {}
    last = [(0, 0.0, 0.0)]

    def look() -> None:
        if not journal.exists() or not (found := working_below(tmp_path)):
            return
        [process] = found
        rows = journal.read_bytes().count(b"\n") if count <= 5000 else int(journal.stat().st_size / 450)
        for mark in (100, 500, 1000, 2000, 10_000, 50_000, 100_000):
            if rows >= mark and mark not in seen:
                seen[mark] = memory_mb(process)
        if rows:
            last[0] = (rows, *memory_mb(process))

    with Launcher() as launcher:
        outcome = launcher.run(plan, look)  # type: ignore[arg-type]
    assert outcome.status == "Completed", outcome
    wall_s = (outcome.ended_at - outcome.started_at).total_seconds()
    table_bytes = (plan.output_dir / "trials.parquet").stat().st_size / count
    journal_bytes = journal.stat().st_size / count
    with capsys.disabled():
        shown = ", ".join(f"{mark}: {now:.1f} (most {most:.1f})" for mark, (now, most) in seen.items())
        print(
            f"\nresident MB of the job's process after so many trials: {shown}; when last seen {last[0][2]:.1f}; "
            f"of this one {memory_mb(os.getpid())[1]:.0f}\n{table_bytes:.0f} bytes a row in the table, "
            f"{journal_bytes:.0f} in the journal; {wall_s:.1f} s for {count}; load {os.getloadavg()[0]:.1f}"
        )
