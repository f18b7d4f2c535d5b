"""Compute of a job on this machine: simulation units as processors and memory, and the GPU."""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ....schemas.runs.programs import ComputeLimits
from ....schemas.wire.errors import LaunchError

DEFAULT_COMPUTE: Mapping[str, Any] = {"simulationUnitLimit": 15, "computeType": "CPU", "gpuUnitLimit": 0}
"""Compute of a job whose request has none."""

_BYTES_PER_UNIT = 2 << 30
_SHARE_OF_DISK = 0.4
"""Share of the free disk that a run may fill: its outputs are written again to be stored, often to the same disk."""
_LEAST_DISK_BYTES = 64 * 10**6
"""A disk that has less left is full soon anyway, and says so itself."""
_GPU = Path("/dev/nvidia0")


def has_gpu(gpu: Path = _GPU) -> bool:
    """Whether this machine has a GPU that jobs can be given."""
    return gpu.exists()


def gpu_of(environ: Mapping[str, str]) -> str:
    """Number or UUID of the GPU that jobs are given: the first that `CUDA_VISIBLE_DEVICES` names, else the first."""
    return environ.get("CUDA_VISIBLE_DEVICES", "").split(",")[0].strip() or "0"


def compute_limits(
    request: Mapping[str, Any], *, gpu: Path = _GPU, cpus: int | None = None, nice: int = 0
) -> ComputeLimits:
    """The limits of a job, but for the disk: a simulation unit is one processor and 2 GiB of memory.

    Args:
        request: the job's request.
        gpu: the device of the first GPU, which is looked for when the job asks for one.
        cpus: processors of this machine; absent: as many as this process may use.
        nice: niceness of all that it starts.

    Raises:
        LaunchError: it asks for a GPU, and there is none.
    """
    compute = {**DEFAULT_COMPUTE, **(request.get("compute") or {})}
    wants_gpu = compute["computeType"] == "GPU_AND_CPU" or compute["gpuUnitLimit"] > 0
    if wants_gpu and not has_gpu(gpu):
        raise LaunchError(
            f"compute.computeType is {compute['computeType']} with gpuUnitLimit {compute['gpuUnitLimit']}, but this "
            f"machine has no GPU ({gpu} is not there); request CPU, or run the job where there is one"
        )
    units = compute["simulationUnitLimit"]
    there = cpus or len(os.sched_getaffinity(0))
    return ComputeLimits(cpus=min(units, there), memory_bytes=units * _BYTES_PER_UNIT, nice=nice, gpu=wants_gpu)


def disk_limit(folder: Path, most_bytes: int) -> int:
    """Limit of a job's files below a folder, in bytes: no job alone can fill the disk, even with copies of files.

    What was fetched for it is not free any more and does not count, so this is asked once all of it is there.

    Args:
        folder: where.
        most_bytes: what it may write to a disk that is large enough.
    """
    free = int(_SHARE_OF_DISK * shutil.disk_usage(folder).free)
    return min(most_bytes, max(free, _LEAST_DISK_BYTES))
