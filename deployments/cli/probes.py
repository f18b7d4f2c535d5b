"""Probes of specifications for `plan --probe`: runs a small part of a specification, and forecasts the whole run."""

import math
import os
import resource
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from ...schemas.reports.forecast import Forecast, Places
from ...schemas.reports.progress import Note, ProgressEvent, ProgressListener, StepEnded, StepStarted
from ...schemas.reports.run_record import RunRecord
from ...schemas.settings import Settings
from ...schemas.specs.parameter_values import set_options
from ...schemas.specs.probe_requests import BATCH, JOB, ProbeSize, cut
from ...schemas.specs.specification import CheckedSpec
from ...schemas.wire.errors import ConfigurationError, RobomakerError
from ...tasks.inspection.forecasting import WholeStep, forecast_run, keep_forecast
from ...tasks.inspection.pipeline_parts import Cut
from ...tasks.inspection.probes import measured, probed_jobs, whole_steps
from ...tasks.nights.cut_runs import removing_made
from ...tasks.nights.wanted_runs import WantedRun
from ...tasks.service.service import Service


@dataclass(frozen=True)
class Machines:
    """Number of machines that a forecast is for, and their price per hour."""

    count: int = 1
    price_per_hour: float | None = None
    """Price of one machine per hour, in any currency; None: no cost is forecast."""

    def check(self, settings: Settings) -> None:
        """Raises an error for an impossible number of machines or price.

        Args:
            settings: Settings of the probe, with its backend.

        Raises:
            ConfigurationError: A number is too small, or jobs run on this machine alone.
        """
        if self.count < 1:
            raise ConfigurationError(f"--machines is {self.count}; a number from 1 would be right")
        if self.count > 1 and settings.backend == "local":
            raise ConfigurationError(
                f"--machines is {self.count}, but the backend is local, which is this machine alone; leave it out, or "
                "name a --backend"
            )
        if self.price_per_hour is not None and not 0 <= self.price_per_hour < math.inf:
            raise ConfigurationError(f"--price-per-hour is {self.price_per_hour:g}; a price from 0 would be right")


_LONGEST_NAME = 94


class ProbeFailedError(RobomakerError):
    """Raised when a probe (small trial run) failed, so that there can be no forecast.

    Args:
        record: The pass that failed.
    """

    def __init__(self, record: RunRecord) -> None:
        errors = [f"{step.name} ({step.operation}): {step.error}" for step in record.steps if step.error]
        errors += [f"{job.title_with_id}: {job.failure_reason}" for job in record.jobs if job.failure_reason]
        why = "; ".join(errors) or f"see {record.report_path or record.run_dir}"
        super().__init__(f"nothing can be forecast, the probe {record.run_id} is {record.state}: {why}")


@dataclass
class CpuTimes:
    """Progress listener that measures the CPU time of each step's processes."""

    listener: ProgressListener
    by_step: dict[str, float] = field(default_factory=dict[str, float])
    """CPU time of each step in seconds, by the step's name."""
    _before_s: float = 0.0

    def __call__(self, event: ProgressEvent, /) -> None:
        """Records the CPU time in seconds that a step's child processes took, and passes the event on."""
        if isinstance(event, StepStarted):
            self._before_s = _of_children_s()
        elif isinstance(event, StepEnded):
            self.by_step[event.step] = _of_children_s() - self._before_s
        self.listener(event)


def _of_children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run_pass(
    spec: CheckedSpec, settings: Settings, size: ProbeSize, listener: ProgressListener, spec_path: str
) -> RunRecord:
    """Runs one pass of a probe (small trial run), and deletes resources that the whole run creates itself.

    Args:
        spec: The specification.
        settings: Settings of the run, with the backend.
        size: Limits of the pass: worlds, jobs and trials.
        listener: Called with the progress of the pass.
        spec_path: The file that the specification is from.

    Raises:
        ProbeFailedError: The pass failed or was cancelled.
        RunInterrupted: Ctrl-C was pressed.
    """
    from ...flows.pipelines import run_spec  # it imports Prefect, which reads its server's address then

    quiet = settings.model_copy(update={"notify": ()})
    service = Service.open(quiet)
    named = replace(spec, name=f"{spec.name[:_LONGEST_NAME]}-probe")
    command = ["robomaker", "plan", spec_path, *set_options(spec.parameters), "--probe"]
    smaller: Cut = lambda operation, request: cut(operation, request, size)  # noqa: E731
    with removing_made(service, listener) as heard:
        record = run_spec(WantedRun(named, spec_path, command, cut=smaller), quiet, heard)
    if record.state not in ("succeeded", "failed"):  # a job whose verdict is FAIL took as long as any
        raise ProbeFailedError(record)
    return record


AGAIN_BELOW_S = 30.0
"""Duration of a first pass below which a second one follows, in seconds.

Most of a short pass may be start-up time.
"""
MORE_BELOW_S = 10.0
"""Duration of a first pass below which the second one runs several jobs per slot, in seconds.

For short jobs, the time between two jobs counts, too.
"""
_ROUNDS = 4
_MOST_KINDS = 12
"""Limit on the kinds of jobs of which one runs in any case."""
_FIRST_TRIALS, _MOST_TRIALS = 4, 1000
_TRIALS_S = 20.0
"""Approximate time for the trials of a job in the second pass, in seconds; the run's overhead is then negligible."""
_WORLDS_PER_CPU = 3
"""Number of worlds per processor in a probe: the first one also waits for the process that makes it."""


def probe(
    spec: CheckedSpec, settings: Settings, machines: Machines, listener: ProgressListener, spec_path: str
) -> Forecast:
    """Runs a probe (small trial run) of a specification, and forecasts the whole run from it.

    Worlds, jobs and reports of the probe are kept like those of any run; the applications and templates that it made
    are deleted, as the run itself is to make them.

    Args:
        spec: The specification; `check_probed` accepts it.
        settings: Settings of the run, with the backend.
        machines: Number of machines, and their price.
        listener: Called with the progress of the probe.
        spec_path: The file that the specification is from.

    Raises:
        ProbeFailedError: A pass of the probe failed or was cancelled.
        RunInterrupted: Ctrl-C was pressed.
    """
    cpus = os.cpu_count() or 1
    worlds = cpus * _WORLDS_PER_CPU
    cpu_times = CpuTimes(listener)
    first = last = run_pass(spec, settings, ProbeSize(worlds, 1, _FIRST_TRIALS), cpu_times, spec_path)
    took_s = (first.ended_at - first.started_at).total_seconds()
    if took_s < AGAIN_BELOW_S and any(step.operation in (JOB, BATCH) for step in first.steps):
        listener(Note("once more, now that everything is running"))
        rounds = _ROUNDS if took_s < MORE_BELOW_S else 1
        kinds = max(len({job.kind for job in step.jobs}) for step in whole_steps(spec, first).values())
        jobs = max(rounds * settings.max_jobs, min(kinds, _MOST_KINDS))
        more = ProbeSize(worlds, jobs, trials_within(_TRIALS_S, first))
        last = run_pass(spec, settings, more, listener, spec_path)
    service = Service.open(settings)
    probes, whole = measured(first, last, cpu_times.by_step, cpus, service), whole_steps(spec, last)
    places = Places(machines=machines.count, jobs_per_machine=settings.max_jobs, cpus=cpus)
    forecast = forecast_run(
        spec.name,
        [(probes[name], whole[name]) for name in spec.order],
        places,
        backend=settings.backend,
        made_at=service.clock(),
        assumed=_assumed(settings, last, whole, is_alone=last is first),
        probes=list(dict.fromkeys((first.run_id, last.run_id))),
        ran=probed_jobs(last),
        price_per_hour=machines.price_per_hour,
    )
    keep_forecast(forecast, spec, settings)
    return forecast


def trials_within(seconds: float, first: RunRecord) -> int:
    """Computes how many trials a probe's job can run in a given time.

    Args:
        seconds: Wall-clock time that they may take.
        first: The first pass.
    """
    each_s = [job.duration_s / trials for job in first.jobs if job.duration_s and (trials := job.metrics.get("trials"))]
    return min(_MOST_TRIALS, max(_FIRST_TRIALS, round(seconds / max(each_s)))) if each_s else _FIRST_TRIALS


def _assumed(settings: Settings, last: RunRecord, whole: Mapping[str, WholeStep], *, is_alone: bool) -> list[str]:
    """Lists the assumptions of a run's forecast, in words."""
    jobs = sum(len(step.jobs) for step in whole.values())
    told = []
    if jobs > len(last.jobs):
        told.append(f"all {jobs} jobs take as long as the {len(last.jobs)} that ran")
        if len({job.kind for step in whole.values() for job in step.jobs}) > 1:
            told.append("jobs with the same limit, applications and launch configurations take as long as each other")
    if jobs > len(last.jobs) and is_alone:
        told.append("jobs side by side are as quick as one alone")
    if settings.backend != "local":
        told.append(
            f"each machine is as quick as those that ran jobs now, and runs {settings.max_jobs} at once, as this one "
            "(ROBOMAKER_MAX_JOBS)"
        )
    return told
