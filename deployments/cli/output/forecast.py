"""A forecast in lines: what the whole run takes, each step, and what the figures rest on."""

from typing import TYPE_CHECKING

from .durations import duration

if TYPE_CHECKING:
    from ....schemas.reports.forecast import Forecast, StepForecast

_UNITS = ("bytes", "kB", "MB", "GB", "TB")


def forecast_lines(forecast: "Forecast") -> list[str]:
    """The lines below a plan."""
    machines = forecast.places.machines
    where = f"{machines} machine{'s' if machines != 1 else ''}, backend {forecast.backend}"
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
    if forecast.assumed:
        lines += ["", *(f"  assumed: {words}" for words in forecast.assumed)]
    return [*lines, f"  measured: {', '.join(forecast.probes)}"]


def size(size_bytes: int) -> str:
    """A size for people: `12 MB`."""
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
