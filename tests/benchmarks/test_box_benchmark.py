"""What a box adds to the start of a job: of a factory, forked warm, and of a program; prints figures, asserts no time.

Runs with and without a box take turns. Each is given the time to have its processes forked ahead, as jobs that do not
come in a flood have. The start is from the launcher's call to the first line of the application.
"""

import os
import statistics
import sys
import time
from pathlib import Path

import pytest
from helpers.run_processes import never

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

ROUNDS = int(os.environ.get("ROUNDS", "20"))
WARM_S = 0.6
FACTORY = """
import os, sys, time
def make_environment(context):
    (context.output_dir / "began").write_text(repr(time.monotonic()))
    sys.stdout.flush()
    os._exit(0)
"""


def plan_run(folder: Path, kind: str) -> RunPlan:
    bundle = folder / "bundle"
    bundle.mkdir(parents=True)
    (bundle / "first_line.py").write_text(FACTORY)
    application = ApplicationPlan(role="simulation", name="first", attribute="first_line.make_environment", path=bundle)
    write = 'echo -n > "$ROBOMAKER_OUTPUT_DIR/began"'
    program = ProgramPlan(
        name="simulation", role="simulation", kind="application", argv=["/bin/sh", "-c", write], folder=bundle
    )
    is_program = kind == "program"
    return RunPlan(
        job_id="sim-1", job_arn="arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-1", run_id="run-1",
        seed=1, max_duration_s=30, work_dir=folder / "work", output_dir=folder / "output",
        simulation_application=ApplicationPlan(role="simulation", name="first") if is_program else application,
        programs=[program] if is_program else [],
    )  # fmt: skip


def start_ms(launcher: Launcher, folder: Path, kind: str) -> float:
    time.sleep(WARM_S)
    plan = plan_run(folder, kind)
    began_s, began = time.monotonic(), time.time()
    launcher.run(plan, never)
    first = plan.output_dir / "began"
    if kind == "program":
        return 1e3 * (first.stat().st_mtime - began)
    return 1e3 * (float(first.read_text()) - began_s)


@pytest.mark.benchmark
def test_starts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    launchers = {}
    for mode in ("off", "require"):
        monkeypatch.setenv("ROBOMAKER_SANDBOX", mode)
        launchers[mode] = Launcher()
        launchers[mode].start()
    for kind in ("factory", "program"):
        taken: dict[str, list[float]] = {"off": [], "require": []}
        for number in range(ROUNDS):
            for mode, launcher in launchers.items():
                monkeypatch.setenv("ROBOMAKER_SANDBOX", mode)
                taken[mode].append(start_ms(launcher, tmp_path / f"{kind}-{mode}-{number}", kind))
        figures = {mode: (statistics.median(times), min(times)) for mode, times in taken.items()}
        more = [figures["require"][index] - figures["off"][index] for index in (0, 1)]
        sys.stdout.write(
            f"{kind}: {figures['off'][0]:.1f} ms without a box, {figures['require'][0]:.1f} in one (medians; at best "
            f"{figures['off'][1]:.1f} and {figures['require'][1]:.1f}): {more[0]:.1f} ms more, at best {more[1]:.1f}\n"
        )
    for launcher in launchers.values():
        launcher.close()
