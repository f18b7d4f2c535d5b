"""Forecasts of a run's duration from the measurements of a probe (small trial run), stored in the data home."""

import hashlib
import heapq
import json
import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ...schemas.reports.forecast import Forecast, ForecastCheck, JobCost, Places, ProbedJob, StepForecast, StepProbe
from ...schemas.reports.run_record import StepRecord
from ...schemas.reports.run_states import is_bad
from ...schemas.settings import Settings
from ...schemas.specs.batch_splitting import MOST_REQUESTS
from ...schemas.specs.probe_requests import BATCH, GENERATION, JobAmount
from ...schemas.specs.specification import CheckedSpec
from ...schemas.specs.yaml_nodes import plain
from ..files.whole_files import write_whole


@dataclass(frozen=True)
class WholeStep:
    """Amount of work of one step in the whole run: numbers of worlds, jobs and trials."""

    jobs: Sequence[JobAmount] = field(default_factory=tuple)
    worlds: int = 0
    max_concurrency: int = 1
    """Maximum number of jobs that a batch runs at the same time."""
    timeout_s: float | None = None
    """Time limit of a batch in seconds."""


def forecast_run(
    name: str,
    steps: Sequence[tuple[StepProbe, WholeStep]],
    places: Places,
    *,
    backend: str,
    made_at: datetime,
    assumed: Sequence[str],
    probes: Sequence[str],
    ran: Sequence[ProbedJob] = (),
    price_per_hour: float | None = None,
) -> Forecast:
    """Forecasts time, disk space and cost of a whole run from the measurements of a probe (small trial run).

    Args:
        name: Name of the specification.
        steps: Measured times of each step in the probe, and its amount of work in the whole run.
        places: Numbers of jobs and worlds that run at once.
        backend: Backend that runs the jobs of batches.
        made_at: Current time.
        assumed: Assumptions of the forecast, as text.
        probes: Ids of the measured runs.
        ran: Measured jobs, with their verdicts.
        price_per_hour: Price of a machine per hour; absent: no cost is computed.
    """
    each = [forecast_step(probe, whole, places) for probe, whole in steps]
    wall_time_s = sum(step.wall_time_s for step in each)
    cpu_times = [step.cpu_time_s for step in each if step.cpu_time_s is not None]
    return Forecast(
        name=name,
        made_at=made_at,
        backend=backend,
        places=places,
        steps=each,
        wall_time_s=wall_time_s,
        cpu_time_s=sum(cpu_times) if len(cpu_times) == len(each) else None,
        size_bytes=sum(step.size_bytes for step in each),
        price_per_hour=price_per_hour,
        cost=None if price_per_hour is None else places.machines * wall_time_s / 3600 * price_per_hour,
        ran=list(ran),
        assumed=list(assumed),
        probes=list(probes),
    )


def forecast_step(probe: StepProbe, whole: WholeStep, places: Places) -> StepForecast:
    """Forecasts time (s) and disk space (bytes) of one step of a run from a probe's measurements.

    A step without jobs and worlds takes as long as it took in the probe.
    """
    if probe.jobs and whole.jobs:
        return _forecast_jobs(probe, whole, places)
    if probe.worlds:
        return _forecast_worlds(probe, whole.worlds, places)
    return StepForecast(
        step=probe.step,
        operation=probe.operation,
        parts=0,
        concurrency=1,
        start_s=probe.wall_time_s,
        wall_time_s=probe.wall_time_s,
        cpu_time_s=0.0,
        size_bytes=0,
    )


def _forecast_worlds(probe: StepProbe, worlds: int, places: Places) -> StepForecast:
    at_once = places.cpus if probe.operation == GENERATION else 1
    start_s = max(0.0, probe.wall_time_s - math.ceil(probe.worlds / at_once) * probe.world_s)
    return StepForecast(
        step=probe.step,
        operation=probe.operation,
        parts=worlds,
        concurrency=max(1, min(at_once, worlds)),
        start_s=start_s,
        wall_time_s=start_s + math.ceil(worlds / at_once) * probe.world_s,
        cpu_time_s=probe.cpu_time_s * worlds / probe.worlds,
        size_bytes=round(probe.size_bytes * worlds / probe.worlds),
    )


def _forecast_jobs(probe: StepProbe, whole: WholeStep, places: Places) -> StepForecast:
    costs = _Costs(probe.jobs)
    room = places.machines * places.jobs_per_machine if probe.operation == BATCH else 1
    at_once = max(1, min(whole.max_concurrency, room, len(whole.jobs)))
    cpus = places.cpus * (places.machines if probe.operation == BATCH else 1)
    first = JobAmount(probe.first_trials, math.inf, whole.jobs[0].kind)
    start_s = max(0.0, probe.wall_time_s - costs.of(first).slot_s(first))
    batches = [whole.jobs[first : first + MOST_REQUESTS] for first in range(0, len(whole.jobs), MOST_REQUESTS)]
    batches_s = [start_s + _batch_s(jobs, costs, at_once, cpus) for jobs in batches]
    cpu_times_s = [costs.of(job).cpu_time_s(job) for job in whole.jobs]
    known_s = [cpu_time_s for cpu_time_s in cpu_times_s if cpu_time_s is not None]
    return StepForecast(
        step=probe.step,
        operation=probe.operation,
        parts=len(whole.jobs),
        concurrency=at_once,
        start_s=start_s,
        wall_time_s=sum(batches_s),
        timeout_s=whole.timeout_s,
        longest_batch_s=max(batches_s) if probe.operation == BATCH else None,
        **_limits(whole.jobs, costs),
        cpu_time_s=sum(known_s) if len(known_s) == len(cpu_times_s) else None,
        size_bytes=round(sum(costs.of(job).size_bytes(job) for job in whole.jobs)),
    )


def _limits(jobs: Sequence[JobAmount], costs: "_Costs") -> dict[str, Any]:
    """Forecasts how many jobs their duration limit will cut off, and which of them takes longest."""
    needed = [(costs.of(job).needed_s(job), job.limit_s) for job in jobs]
    over = [(needed_s, limit_s) for needed_s, limit_s in needed if needed_s >= limit_s]
    job_s, job_limit_s = max(over, default=(None, None))
    return {"over_limit": len(over), "job_s": job_s, "job_limit_s": job_limit_s}


def _batch_s(jobs: Sequence[JobAmount], costs: "_Costs", at_once: int, cpus: int) -> float:
    """Forecasts the wall-clock time of a batch without its start and end, limited by free places and CPU time."""
    computing_s = sum(costs.of(job).cpu_time_s(job) or 0.0 for job in jobs) / cpus
    return max(makespan_s([costs.of(job).slot_s(job) for job in jobs], at_once), computing_s)


def makespan_s(durations_s: Sequence[float], places: int) -> float:
    """Computes when the last job ends, in seconds, if jobs take the first free of several places in order.

    Args:
        durations_s: Seconds that each job occupies its place.
        places: Number of places.
    """
    free_at = [0.0] * places
    for duration_s in durations_s:
        heapq.heapreplace(free_at, free_at[0] + duration_s)
    return max(free_at)


class _Costs:
    """Expected costs of jobs: the mean of the probe's jobs of the same kind, else of all jobs of the probe.

    Args:
        jobs: Jobs of the probe, at least one.
    """

    def __init__(self, jobs: Sequence[JobCost]) -> None:
        self._of_all = _MeanCost.of(jobs)
        kinds = dict.fromkeys(job.kind for job in jobs)
        self._of_kind = {kind: _MeanCost.of([job for job in jobs if job.kind == kind]) for kind in kinds}

    def of(self, job: JobAmount) -> "_MeanCost":
        return self._of_kind.get(job.kind, self._of_all)


@dataclass(frozen=True)
class _MeanCost:
    """Mean times, CPU share and output size of measured simulation jobs."""

    around_s: float
    """Seconds in which a job occupies a place before and after its run."""
    trial_s: float
    """Run time of a trial in seconds."""
    cpu_share: float | None
    """CPU seconds per second of a run; None: unknown."""
    bytes_per_s: float
    """Bytes of outputs per second of a run."""

    @classmethod
    def of(cls, jobs: Sequence[JobCost]) -> "_MeanCost":
        run_s = max(sum(job.run_s for job in jobs), 1e-6)
        cpu_times = [job.cpu_time_s for job in jobs if job.cpu_time_s is not None]
        return cls(
            around_s=sum(max(0.0, job.slot_s - job.run_s) for job in jobs) / len(jobs),
            trial_s=run_s / sum(job.trials for job in jobs),
            cpu_share=sum(cpu_times) / run_s if len(cpu_times) == len(jobs) else None,
            bytes_per_s=sum(job.size_bytes for job in jobs) / run_s,
        )

    def needed_s(self, job: JobAmount) -> float:
        """Estimates the run time of a job in seconds without its time limit."""
        return job.trials * self.trial_s

    def run_s(self, job: JobAmount) -> float:
        return min(self.needed_s(job), job.limit_s)

    def slot_s(self, job: JobAmount) -> float:
        return self.around_s + self.run_s(job)

    def cpu_time_s(self, job: JobAmount) -> float | None:
        return None if self.cpu_share is None else self.cpu_share * self.run_s(job)

    def size_bytes(self, job: JobAmount) -> float:
        return self.bytes_per_s * self.run_s(job)


_FOLDER = "forecasts"
_logger = logging.getLogger(__name__)


def keep_forecast(forecast: Forecast, spec: CheckedSpec, settings: Settings) -> Path:
    """Stores a forecast for later runs of the specification, replacing an earlier forecast.

    Raises:
        OSError: The forecast cannot be written.
    """
    path = _place(spec, settings)
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_whole(path, forecast.model_dump_json(indent=2, exclude_none=True))


def find_forecast(spec: CheckedSpec, settings: Settings) -> Forecast | None:
    """Reads the stored forecast of a specification; `None` if there is none or it cannot be read, which is logged."""
    path = _place(spec, settings)
    try:
        return Forecast.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValidationError) as problem:
        _logger.warning("the forecast %s cannot be read: %s", path, problem)
        return None


def check_forecast(
    spec: CheckedSpec, settings: Settings, steps: Sequence[StepRecord], started_at: datetime, ended_at: datetime
) -> ForecastCheck | None:
    """Compares a finished run's wall time to its forecast; `None` without one, or if a step failed or was skipped."""
    if any(is_bad(step.status) or step.status == "Skipped" for step in steps):
        return None
    forecast = find_forecast(spec, settings)
    if forecast is None:
        return None
    took_s = (ended_at - started_at).total_seconds()
    return ForecastCheck(made_at=forecast.made_at, forecast_s=forecast.wall_time_s, took_s=took_s)


def _place(spec: CheckedSpec, settings: Settings) -> Path:
    """Returns the path of the forecast; it depends on the specification without its names and comments."""
    steps = {
        name: [step.operation, plain(step.input), list(step.needs), *([step.parameters] if step.parameters else [])]
        for name, step in spec.steps.items()
    }
    canonical = json.dumps([settings.backend, steps], sort_keys=True, default=str)
    return settings.home / _FOLDER / f"{hashlib.sha256(canonical.encode()).hexdigest()[:32]}.json"
