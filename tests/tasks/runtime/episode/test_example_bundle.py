"""The example bundle, the way a user's comes: packed, unpacked, run."""

import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY
from mcap.reader import make_reader

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan, RunResult
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.storage import unpack

EXAMPLE = REPOSITORY / "deployments" / "specs" / "examples" / "cartpole_bundle"


@pytest.fixture
def unpacked(tmp_path: Path) -> Path:
    source = shutil.copytree(EXAMPLE, tmp_path / "source", ignore=shutil.ignore_patterns("__pycache__"))
    with tarfile.open(tmp_path / "cartpole.tar.gz", "w:gz") as archive:
        archive.add(source / "my_cartpole", arcname="my_cartpole")
    unpack(tmp_path / "cartpole.tar.gz", tmp_path / "unpacked")
    return tmp_path / "unpacked"


@pytest.mark.parametrize(("gain", "verdict"), [("1", "PASS"), ("0", "FAIL")])
def test_from_archive_to_verdict(
    launcher: Launcher, make_plan: Callable[..., RunPlan], unpacked: Path, gain: str, verdict: str
) -> None:
    plan = make_plan(
        simulation_application=ApplicationPlan(
            role="simulation", name="cartpole", attribute="my_cartpole.arena.make_environment", path=unpacked
        ),
        robot_application=ApplicationPlan(
            role="robot",
            name="balancer",
            attribute="my_cartpole.agent.make_agent",
            path=unpacked,
            environment_variables={"GAIN": gain},
        ),
    )
    outcome = launcher.run(plan, lambda: None)
    assert outcome.status == "Completed", outcome.failure_reason
    result = RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())
    assert (result.verdict, result.ended_by) == (verdict, "environment")
    assert [item.name for item in result.requirements] == ["upright"]
    with (plan.output_dir / "recording.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert {channel.topic for channel in summary.channels.values()} == {"/clock", "/joint_states"}
    assert (plan.output_dir / "logs/stdout.log").read_text() == "cartpole with seed 5, 10 s\n"
