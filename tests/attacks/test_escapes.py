"""A job that attacks the machine that it runs on: without a box all of it succeeds, in a box nothing."""

import itertools
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.paths import TESTS
from helpers.run_processes import never

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.runtime.sandbox.kernel import landlock_version
from prefect_robomaker.tasks.runtime.sandbox.levels import Confinement
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.supervision.run_requests import plan_box

ESCAPES = TESTS / "attacks" / "escapes"
NOT_STOPPED_BY_LANDLOCK = {
    *("touch the catalog", "rights", "socket", "tcp", "tcp of version 6", "udp", "network cards"),
    *("processes", "descriptors of a process", "group of a process", "session of a process", "limits of a process"),
    *("temporary files", "shared memory", "shared memory of System V"),
}
"""As `docs/sandbox.md` says; a run without a network of its own reaches TCP."""


@pytest.fixture(scope="module")
def launcher(key: str | None) -> Iterator[Launcher]:
    """One of its own, whose processes inherit the keyring that has the key."""
    del key
    with Launcher() as launcher:
        launcher.start()
        yield launcher


@pytest.fixture
def attack(
    launcher: Launcher, tmp_path: Path, targets: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., dict[str, str]]:
    """Runs a job that tries everything; returns what succeeded."""
    numbers = itertools.count(1)

    def run(kind: str, mode: str, network: str = "full") -> dict[str, str]:
        monkeypatch.setenv("ROBOMAKER_SANDBOX", mode)
        monkeypatch.setenv("ROBOMAKER_SANDBOX_NETWORK", network)
        monkeypatch.setenv("ROBOMAKER_HOME", str(tmp_path / "home"))
        plan = plan_attack(kind, tmp_path, targets, f"run-{next(numbers)}")
        outcome = launcher.run(plan, never)
        assert (plan.output_dir / "escapes.json").exists(), outcome.failure_reason
        return json.loads((plan.output_dir / "escapes.json").read_text())

    return run


def plan_attack(kind: str, tmp_path: Path, targets: dict[str, Any], run_id: str) -> RunPlan:
    folder = tmp_path / "home/runs" / run_id
    bundle = folder / "bundle"
    bundle.mkdir(parents=True)
    (bundle / "escapes.py").write_bytes((ESCAPES / "escapes.py").read_bytes())
    application = ApplicationPlan(role="simulation", name="attack")
    if kind == "factory":
        application = ApplicationPlan(
            role="simulation", name="attack", attribute="escapes.make_environment", path=bundle
        )
    program = ProgramPlan(
        name="simulation", role="simulation", kind="application", argv=[sys.executable, "escapes.py"], folder=bundle
    )
    return RunPlan(
        job_id="sim-1", job_arn="arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-1", run_id=run_id,
        seed=1, max_duration_s=120, work_dir=folder / "work", output_dir=folder / "output",
        data_dir=tmp_path / "home/runs/data", root_dir=folder / "root", simulation_application=application,
        programs=[program] if kind == "program" else [], environment={"TARGETS": json.dumps(targets)},
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["program", pytest.param("factory", marks=pytest.mark.deep)])
def test_all_succeed_without_a_box_and_none_in_one_and_landlock_stops_what_the_page_says(
    launcher: Launcher,
    attack: Callable[..., dict[str, str]],
    targets: dict[str, Any],
    kind: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    has_boxes, has_landlock = launcher._box().level == "box", landlock_version() >= 6

    assert set(attack(kind, "off")) - {"descriptors"} == set(targets)
    for network in ("none", "local") if has_boxes else ():
        assert attack(kind, "require", network) == {}, network
    if has_landlock:
        settings = Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "home")})
        box = plan_box(settings, Confinement("landlock", "as a test"), tmp_path / "user")
        monkeypatch.setattr(launcher, "_box", lambda: box)
        assert set(attack(kind, "auto")) - {"descriptors"} <= NOT_STOPPED_BY_LANDLOCK
    if not (has_boxes and has_landlock):
        pytest.skip(f"the rest: user namespaces {has_boxes}, Landlock with scopes {has_landlock}")
