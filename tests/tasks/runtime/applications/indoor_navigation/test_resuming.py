"""The built-in applications go on from a checkpoint in a new process as if nothing had been."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.small_flat import BODY
from mcap.reader import make_reader

from prefect_robomaker.schemas.runs.axes import AxisSetting
from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan, RunResult
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world

BUILT_INS = "prefect_robomaker.tasks.runtime.applications"


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("worlds") / "small-flat"
    write_bundle(generate_world(WorldTemplateBody.model_validate(BODY), 1, 2), folder)
    return folder


def messages(path: Path) -> Iterator[tuple[str, int, bytes]]:
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            yield channel.topic, message.log_time, message.data


@pytest.mark.parametrize(
    ("robot", "every_s"), [("scout", 0.3), pytest.param("walker", 2.0, marks=pytest.mark.endurance)]
)
def test_navigation_continues_to_the_bit(
    launcher: Launcher, world: Path, tmp_path: Path, robot: str, every_s: float
) -> None:
    plan = RunPlan(
        job_id="sim-1", job_arn="arn:sim-1", run_id="run-1", seed=4, max_duration_s=120.0, world_dir=world,
        work_dir=tmp_path / "work", output_dir=tmp_path / "out",
        robot_application=ApplicationPlan(role="robot", name=robot, attribute=f"{BUILT_INS}.{robot}.make_agent"),
        checkpoint_dir=tmp_path / "checkpoints", checkpoint_every_s=every_s,
        # What wanders off goes on from where it was, too.
        axes={"drift": AxisSetting(kind="odometry_drift_std_m", value=0.01)},
    )  # fmt: skip
    assert launcher.run(plan, lambda: None).status == "Completed"
    whole = tmp_path / "whole"
    shutil.copytree(plan.output_dir, whole)
    kept = sorted((tmp_path / "checkpoints").glob("checkpoint-*.bin"))
    assert kept
    for newer in kept[1:]:
        newer.unlink()  # the oldest, so that there is more to repeat

    # What it wrote after the checkpoint is there, as it is of a run that was killed.
    assert launcher.run(plan, lambda: None).status == "Completed"

    one, other = (
        RunResult.model_validate_json((each / "result.json").read_bytes()) for each in (whole, plan.output_dir)
    )
    different = {"wall_time_s", "real_time_factor"}
    assert one.model_dump(exclude=different) == other.model_dump(exclude=different)
    assert one.state_digest is not None
    assert list(messages(whole / "recording.mcap")) == list(messages(plan.output_dir / "recording.mcap"))
    assert "begins anew" not in (plan.output_dir / "logs" / "stderr.log").read_text()
