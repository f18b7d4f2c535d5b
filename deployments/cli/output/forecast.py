"""Formats forecasts of a run's time, disk space and cost as text, and what it would reuse of earlier runs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from ....schemas.wire.common import counted, passed_of
from .answers import duration

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ....schemas.reports.comparison import AxisPairs, PlannedPairs
    from ....schemas.reports.forecast import Forecast, ProbedJob, StepForecast
    from ....tasks.inspection.reuse_plans import PlannedPart


_MOST_TOLD = 5
_ENDING_S = 5.0
"""Time in seconds by which a measured need must exceed a job's limit to be stated as a number.

The end of a job that reached its limit takes some seconds, so a smaller excess only says that more is needed.
"""
_AS_MUCH = 1.05
"""Factor by which a measured need must exceed a job's limit to be stated as a number and not only as "more"."""
_TESTS = {
    "exact McNemar": "the exact McNemar test",
    "sign flip of worlds": "the test that flips whole worlds",
    "Tango's score": "Tango's score test",
    "interval between worlds": "the interval between worlds",
    "e-process": "the evidence of `run --against`",
}
_UNITS = ("bytes", "kB", "MB", "GB", "TB")


def forecast_lines(forecast: "Forecast") -> list[str]:
    """Formats a forecast of time, disk space and cost as text lines."""
    machines = forecast.places.machines
    where = f"{counted(machines, 'machine')}, backend {forecast.backend}"
    rows = [
        ("wall time", duration(forecast.wall_time_s)),
        ("CPU", "not known" if forecast.cpu_time_s is None else _cpu_time(forecast.cpu_time_s)),
        ("outputs", size(forecast.size_bytes)),
    ]
    if forecast.cost is not None:
        rows.append(("cost", f"{forecast.cost:.4f}, at {forecast.price_per_hour:g} for an hour of a machine"))
    lines = [f"forecast for {where}:", *(f"  {name:<10} {value}" for name, value in rows)]
    longest = max(len(step.step) for step in forecast.steps)
    lines += ["", *(f"  {step.step:<{longest}}  {_step(step)}" for step in forecast.steps)]
    if warnings := [line for step in forecast.steps for line in _warnings(step)]:
        lines += ["", *(f"  warning: {words}" for words in warnings)]
    if forecast.ran:
        lines += ["", *_ran(forecast.ran)]
    if forecast.assumed:
        lines += ["", *(f"  assumed: {words}" for words in forecast.assumed)]
    return [*lines, f"  measured: {', '.join(forecast.probes)}"]


def needed_lines(needed: "PlannedPairs", ways: "Sequence[str]" = ()) -> list[str]:
    """Formats how many trials answer a question about two runs as text lines, the number first.

    Args:
        needed: The numbers.
        ways: Numbers of the specification that give enough trials, each alone.
    """
    points = f"{needed.difference * 100:.3g} points"
    question = f"that nothing got worse by {points}" if needed.basis == "margin" else f"a difference of {points}"
    took = [] if needed.wall_time_s is None else [duration(needed.wall_time_s)]
    took += [] if needed.cost is None else [f"cost {needed.cost:.4f}"]
    worlds = f" in {counted(needed.worlds, 'world')}" if needed.worlds else ""
    trials = counted(needed.pairs, "trial")
    lines = [
        f"to show {question} with a chance of {needed.power:.0%}: "
        f"{', '.join([f'{trials}{worlds} in each of two runs', *took])}",
        f"  decided by  {_TESTS[needed.test]}",
    ]
    if needed.median is not None:
        lines.append(f"  stops       after {counted(needed.median, 'trial')} or fewer in half of the runs")
    if needed.planned is not None:
        enough = f"{needed.more} too few" if needed.more else "enough"
        lines.append(f"  a run has   {counted(needed.planned, 'trial')}: {enough}")
    if ways:
        lines.append(f"  to get them {', or '.join(ways)}")
    if needed.smallest is not None and needed.more:
        lines.append(f"  they        {_shown_by_planned(needed, needed.smallest)}")
    return [*lines, *(f"  assumed: {words}" for words in needed.assumed)]


def _shown_by_planned(needed: "PlannedPairs", smallest: float) -> str:
    """Says which difference the planned trials show: pass rates differ by no more than the share of pairs that do."""
    points = f"{smallest * 100:.3g} points"
    if needed.basis == "margin":
        return f"exclude a fall by {points}"
    if smallest <= needed.discordant:
        return f"show a difference of {points}"
    return (
        f"show no difference where {100 * needed.discordant:.3g}% of pairs differ; they would where "
        f"{100 * smallest:.3g}% differ, all the same way"
    )


def axis_lines(axes: "Sequence[AxisPairs]") -> list[str]:
    """Formats which axes of a run can be told apart by their values, as text lines."""
    lines = ["values of an axis within one run, by `robomaker compare RUN --axis NAME=VALUE`:"]
    for each in axes:
        noun = "world" if each.of_worlds else "pair"
        can = f"{'a' if each.pairs >= each.least else 'no'} difference of its values can be shown"
        lines.append(f"  {each.step}.{each.axis}: {counted(each.pairs, noun)}; {can}; {each.least} is the least")
    return lines


def _warnings(step: "StepForecast") -> list[str]:
    """Returns warnings that a batch or its jobs would reach their time limits before they finish."""
    told = []
    timeout_s, takes_s = step.timeout_s, step.longest_batch_s
    if timeout_s is not None and takes_s is not None and takes_s > timeout_s:
        told.append(
            f"{step.step}: its batch takes {duration(takes_s)} and is ended after {duration(timeout_s)} "
            f"(batchPolicy.timeoutInSeconds is {timeout_s:.0f}); jobs that have not finished by then fail"
        )
    limit_s, needs_s = step.job_limit_s, step.job_s
    if limit_s is not None and needs_s is not None:
        jobs = "1 job is" if step.over_limit == 1 else f"{step.over_limit} jobs are"
        needs = "more" if needs_s < max(_AS_MUCH * limit_s, limit_s + _ENDING_S) else f"about {duration(needs_s)}"
        told.append(
            f"{step.step}: {jobs} ended by the limit (maxJobDurationInSeconds is {limit_s:.0f}); {needs} would be right"
        )
    return told


def _ran(jobs: "Sequence[ProbedJob]") -> list[str]:
    """Describes how the jobs of a probe (small trial run) ended: counts of verdicts, then jobs that did not pass."""
    counts = Counter(job.verdict for job in jobs)
    told = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    lines = [f"  ran: {counted(len(jobs), 'job')}: {told}"]
    bad = [job for job in jobs if job.verdict != "PASS"]
    lines += [f"    {_verdict(job)}" for job in bad[:_MOST_TOLD]]
    return lines + ([f"    … and {len(bad) - _MOST_TOLD} more"] if len(bad) > _MOST_TOLD else [])


def _verdict(job: "ProbedJob") -> str:
    trials = "" if job.trials is None else f", {passed_of(job.trials_passed or 0, job.trials, 'trial')}"
    reason = job.reason.partition("\n")[0]
    return f"{job.job} {job.verdict}{trials}{f': {reason}' if reason else ''}"


def size(size_bytes: int) -> str:
    """Formats a number of bytes: `12 MB`."""
    value, unit = float(size_bytes), 0
    while value >= 1000 and unit < len(_UNITS) - 1:
        value, unit = value / 1000, unit + 1
    return f"{value:.3g} {_UNITS[unit]}"


def _cpu_time(cpu_time_s: float) -> str:
    return (
        f"{cpu_time_s / 3600:.2g} hours"
        if cpu_time_s >= 360
        else f"{duration(cpu_time_s)} ({cpu_time_s / 3600:.2g} hours)"
    )


def _step(step: "StepForecast") -> str:
    took = duration(step.wall_time_s)
    if not step.parts:
        return took
    return f"{took}: {step.parts}, {step.concurrency} at a time, {duration(step.start_s)} of it start and end"


def reuse_lines(parts: "Sequence[PlannedPart]") -> list[str]:
    """Formats which parts of a step are reused or run: `run requests 2 to 4: its world is generated first`."""
    lines = []
    for (reuse, why), group in groupby(parts, key=lambda part: (part.reuse, part.why)):
        names = [part.part for part in group]
        lines.append(f"{'reuse' if reuse else 'run  '}  {_together(names)}: {why}")
    return lines


def reuse_total(parts: "Mapping[str, Sequence[PlannedPart]]") -> str:
    """Formats how much of a run is reused: `4 of 4 worlds and 3 of 4 simulation jobs are taken over`."""
    told = []
    for noun, is_it in (("worlds", True), ("simulation jobs", False)):
        these = [part for each in parts.values() for part in each if part.part.startswith("world") is is_it]
        if these:
            told.append(f"{sum(part.reuse for part in these)} of {len(these)} {noun}")
    return f"{' and '.join(told)} are taken over" if told else "nothing here can be taken over"


def why_nothing(parts: "Mapping[str, Sequence[PlannedPart]]") -> str | None:
    """Explains why a run would reuse nothing; `None` if it would.

    Jobs whose worlds are generated first have no reason of their own.
    """
    from ....tasks.inspection.reuse_plans import NEW_WORLD

    if not parts or any(part.reuse for each in parts.values() for part in each):
        return None
    first = {step: each[0].why for step, each in parts.items() if each}
    own = {step: why for step, why in first.items() if why != NEW_WORLD} or first
    reasons = "; ".join(f"{step}: {why}" for step, why in own.items())
    return f"--reuse takes nothing over: {reasons}"


def _together(names: Sequence[str]) -> str:
    first, last = names[0], names[-1]
    if len(names) == 1:
        return first
    noun, _, _ = first.rpartition(" ")
    return f"{noun}s {first.rpartition(' ')[2]} to {last.rpartition(' ')[2]}"
