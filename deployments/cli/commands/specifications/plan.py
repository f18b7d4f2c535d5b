"""Show the steps of a specification in the order they would run.

Runs nothing, except with `--probe`. With `--reuse` it says of each world and each simulation job whether `robomaker
run --reuse` would take it over from an earlier run, and if not, why: what is new, or which input has changed.

With `--probe` it runs a few worlds, a job of each step and a few of its trials, and says what the whole run will take:
wall time, CPU hours, bytes and, given a price, cost. The next run of SPEC says how far off that was.
"""

import argparse
import os
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

from .....schemas.wire.errors import ConfigurationError
from ...arguments import add_backend, add_output, add_spec
from ...inputs.options import open_service
from ...output.answers import in_columns, print_either

if TYPE_CHECKING:
    from .....schemas.reports.forecast import Forecast
    from .....schemas.specs.model import CheckedSpec
    from .....tasks.inspection.reuse_plans import PlannedPart
    from ...planning import PlannedStep


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker plan` to its parser."""
    add_spec(parser)
    parser.add_argument("--reuse", action="store_true", help="say what a run with --reuse would run, and why")
    parser.add_argument("--probe", action="store_true", help="run one job of each step and forecast the whole run")
    parser.add_argument("--machines", metavar="N", type=int, help="machines of the backend; for --probe (default: 1)")
    parser.add_argument(
        "--price-per-hour", metavar="P", type=float, help="price of a machine for an hour, in any currency; for --probe"
    )
    add_backend(parser)
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker plan`: prints the steps of a specification, without running them."""
    from ...inputs.specifications import read_spec
    from ...planning import planned

    _check(arguments)
    spec = read_spec(arguments.spec)
    steps = planned(spec)
    parts = _reuse(spec) if arguments.reuse else {}
    forecast = _forecast(spec, arguments) if arguments.probe else None
    print_either(
        arguments.output, _document(spec, steps, parts, forecast), _lines(arguments, spec, steps, parts, forecast)
    )
    return 0


def _check(arguments: argparse.Namespace) -> None:
    for option in ("machines", "price_per_hour", "backend"):
        if getattr(arguments, option) is not None and not arguments.probe:
            raise ConfigurationError(f"--{option.replace('_', '-')} is for --probe; add that, or leave it out")
    if arguments.probe and arguments.reuse:
        raise ConfigurationError("--probe forecasts a run that takes nothing over; leave --reuse out")


def _document(
    spec: "CheckedSpec",
    steps: "list[PlannedStep]",
    parts: "dict[str, list[PlannedPart]]",
    forecast: "Forecast | None",
) -> dict[str, object]:
    each = [asdict(step) | _reuse_as_json(parts.get(step.step)) for step in steps]
    document: dict[str, object] = {"schema_version": 1, "name": spec.name, "steps": each}
    if forecast is not None:
        document["forecast"] = {**forecast.model_dump(mode="json", exclude_none=True), "cpu_hours": forecast.cpu_hours}
    return document


def _lines(
    arguments: argparse.Namespace,
    spec: "CheckedSpec",
    steps: "list[PlannedStep]",
    parts: "dict[str, list[PlannedPart]]",
    forecast: "Forecast | None",
) -> Iterator[str]:
    from ...output.forecast import forecast_lines, reuse_lines, reuse_total
    from ...planning import after, counted

    yield f"{spec.name}: {counted(len(steps), 'step')}, one after the other\n"
    rows = [(str(number), step.step, step.operation, after(step), step.detail) for number, step in enumerate(steps, 1)]
    for line, step in zip(in_columns(rows), steps, strict=True):
        yield f"  {line}"
        yield from (f"       {line}" for line in reuse_lines(parts.get(step.step, [])))
    if arguments.reuse:
        yield f"\n{reuse_total(parts)}"
    if forecast is not None:
        yield "\n" + "\n".join(forecast_lines(forecast))
    options = f"{' --reuse' if arguments.reuse else ''}{f' --backend {arguments.backend}' if arguments.backend else ''}"
    yield f"\nrobomaker run {arguments.spec}{options}"


def _forecast(spec: "CheckedSpec", arguments: argparse.Namespace) -> "Forecast":
    """Runs a probe of the specification."""
    from .....schemas.specs.probe_requests import check_probed
    from ...output.progress import watcher
    from ...pipelines import settings_of
    from ...prefect_server import use_server
    from ...probes import Machines
    from ...signals import interrupted_by_signals

    settings = settings_of(arguments)
    machines = Machines(1 if arguments.machines is None else arguments.machines, arguments.price_per_hour)
    machines.check(settings)
    check_probed(spec)
    use_server(settings, for_runs=True)
    steps = [(name, spec.steps[name].operation) for name in spec.order]
    with interrupted_by_signals(), watcher(steps, os.environ) as listener:
        from ...probes import probe

        return probe(spec, settings, machines, listener, arguments.spec)


def _reuse(spec: "CheckedSpec") -> "dict[str, list[PlannedPart]]":
    """Plans which parts a run would reuse, by step."""
    from .....tasks.inspection.reuse_plans import plan_reuse

    return plan_reuse(spec, open_service())


def _reuse_as_json(parts: "list[PlannedPart] | None") -> dict[str, object]:
    return {} if parts is None else {"parts": [asdict(part) for part in parts]}
