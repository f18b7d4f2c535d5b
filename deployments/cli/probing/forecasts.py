"""Forecast of a whole run from a probe.

Everything that a run starts is started in the first pass. Where that was short, a second pass runs as many jobs as
find room at once: their times are those of jobs that find everything running.
"""

import os
from collections.abc import Mapping

from ....schemas.reports.forecast import Forecast, Places
from ....schemas.reports.progress import Note, ProgressListener
from ....schemas.reports.run_record import RunRecord
from ....schemas.settings import Settings
from ....schemas.specs.model import CheckedSpec
from ....schemas.specs.probe_requests import BATCH, JOB, ProbeSize
from ....tasks.inspection.forecasting import WholeStep, forecast_run
from ....tasks.inspection.kept_forecasts import keep_forecast
from ....tasks.inspection.probes import measured, probed_jobs, whole_steps
from ....tasks.service.service import Service
from .machines import Machines
from .passes import CpuTimes, run_pass

AGAIN_BELOW_S = 30.0
"""A first pass that took less is followed by another: starting things may be most of what it took."""
MORE_BELOW_S = 10.0
"""One that took less runs several jobs in each place then: of short jobs, what lies between two counts, too."""
_ROUNDS = 4
_MOST_KINDS = 12
"""Limit on the kinds of jobs of which one runs in any case."""
_FIRST_TRIALS, _MOST_TRIALS = 4, 1000
_TRIALS_S = 20.0
"""About how long the trials of a job may take in the second pass: what a run takes around them is hardly seen then."""
_WORLDS_PER_CPU = 3
"""The first world of a processor also waits for the process that makes it."""


def probe(
    spec: CheckedSpec, settings: Settings, machines: Machines, listener: ProgressListener, spec_path: str
) -> Forecast:
    """Runs a probe, and keeps the forecast for the next run of the specification.

    Worlds, jobs and reports of the probe are kept like those of any run; the applications and templates that it made
    are deleted, as the run itself is to make them.

    Args:
        spec: the specification; `check_probed` accepts it.
        settings: where everything is kept, with the backend.
        machines: how many there are to be, and what they cost.
        listener: told how the probe goes.
        spec_path: the file that the specification is from.

    Raises:
        ProbeFailedError: the probe did not come to its end.
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
    """How many trials a job may have, by those of the first pass, of which the start of the run is a part.

    Args:
        seconds: wall-clock time that they may take.
        first: the first pass.
    """
    each_s = [job.duration_s / trials for job in first.jobs if job.duration_s and (trials := job.metrics.get("trials"))]
    return min(_MOST_TRIALS, max(_FIRST_TRIALS, round(seconds / max(each_s)))) if each_s else _FIRST_TRIALS


def _assumed(settings: Settings, last: RunRecord, whole: Mapping[str, WholeStep], *, is_alone: bool) -> list[str]:
    """Lists the assumptions of a forecast, in words."""
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
