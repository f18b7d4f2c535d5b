"""What a job may use of this machine: simulation units as processors and memory, and the GPU."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..schemas.errors import LaunchError
from ..schemas.run_programs import ComputeLimits

DEFAULT_COMPUTE: Mapping[str, Any] = {"simulationUnitLimit": 15, "computeType": "CPU", "gpuUnitLimit": 0}
"""What a job has that says nothing."""

_BYTES_PER_UNIT = 2 << 30
_GPU = Path("/dev/nvidia0")


def has_gpu(gpu: Path = _GPU) -> bool:
    """Whether this machine has a GPU that jobs can be given."""
    return gpu.exists()


def compute_limits(request: Mapping[str, Any], *, gpu: Path = _GPU, cpus: int | None = None) -> ComputeLimits:
    """The limits of a job: a simulation unit is one processor and 2 GiB of memory.

    Args:
      request: the job's request.
      gpu: the device of the first GPU, which is looked for when the job asks for one.
      cpus: processors of this machine; absent: as many as this process may use.

    Raises:
      LaunchError: it asks for a GPU, and there is none.
    """
    compute = {**DEFAULT_COMPUTE, **(request.get("compute") or {})}
    wants_gpu = compute["computeType"] == "GPU_AND_CPU" or compute["gpuUnitLimit"] > 0
    if wants_gpu and not has_gpu(gpu):
        raise LaunchError(
            f"compute.computeType is {compute['computeType']} with gpuUnitLimit {compute['gpuUnitLimit']}, but this "
            f"machine has no GPU ({gpu} is not there); order CPU, or perform the job where there is one",
            "InvalidInput",
        )
    units = compute["simulationUnitLimit"]
    there = cpus or len(os.sched_getaffinity(0))
    return ComputeLimits(cpus=min(units, there), memory_bytes=units * _BYTES_PER_UNIT, gpu=wants_gpu)
