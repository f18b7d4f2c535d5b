"""Simulation units and GPUs of a job on this machine."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.simulations.environment.run_environment import compute_limits, disk_limit


@pytest.mark.parametrize(
    ("compute", "cpus", "gibibytes"),
    [(None, 8, 30), ({}, 8, 30), ({"simulationUnitLimit": 3}, 3, 6), ({"simulationUnitLimit": 15}, 8, 30)],
)
def test_a_unit_is_a_processor_and_two_gibibytes(compute: Any, cpus: int, gibibytes: int) -> None:
    limits = compute_limits({"compute": compute}, cpus=8)

    assert limits.cpus == cpus
    assert limits.memory_bytes == gibibytes << 30
    assert not limits.gpu


def test_a_gpu_is_there_or_the_job_fails_with_a_reason(tmp_path: Path) -> None:
    request = {"compute": {"computeType": "GPU_AND_CPU", "gpuUnitLimit": 1}}
    device = tmp_path / "nvidia0"

    with pytest.raises(LaunchError, match=r"no GPU .*request CPU") as caught:
        compute_limits(request, gpu=device)
    assert caught.value.failure_code == "InvalidInput"
    device.touch()
    assert compute_limits(request, gpu=device).gpu


def test_a_job_cannot_fill_the_disk_alone(tmp_path: Path) -> None:
    free = shutil.disk_usage(tmp_path).free

    assert disk_limit(tmp_path, 1000) == 1000
    assert disk_limit(tmp_path, 2 * free) == pytest.approx(0.4 * free, rel=0.01)
