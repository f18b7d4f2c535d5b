"""Show the steps of a specification in the order they would run.

Runs nothing, except with `--probe`. With `--reuse` it says of each world and each simulation job whether `robomaker
run --reuse` would take it over from an earlier run, and if not, why: what is new, or which input has changed.

With `--probe` it runs a few worlds, a job of each step and a few of its trials, and says what the whole run will take:
wall time, CPU hours, bytes and, given a price, cost. The next run of SPEC says how far off that was.
"""

import argparse
import json
import os
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING

from .....schemas.wire.errors import ConfigurationError
from ...arguments import add_backend, add_output, add_spec

if TYPE_CHECKING:
    from .....schemas.reports.forecast import Forecast
    from .....schemas.specs.model import CheckedSpec
    from .....tasks.inspection.reuse_plans import PlannedPart
    from ...planning import PlannedStep


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
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
    """Prints the plan."""
    from ...inputs.specifications import read_spec
    from ...planning import planned

    _check(arguments)
    spec = read_spec(arguments.spec)
    steps = planned(spec)
    parts = _reuse(spec) if arguments.reuse else {}
    forecast = _forecast(spec, arguments) if arguments.probe else None
    if arguments.output == "json":
        _print_json(spec, steps, parts, forecast)
    else:
        _print_text(arguments, spec, steps, parts, forecast)
    return 0


def _check(arguments: argparse.Namespace) -> None:
    for option in ("machines", "price_per_hour", "backend"):
        if getattr(arguments, option) is not None and not arguments.probe:
            raise ConfigurationError(f"--{option.replace('_', '-')} is for --probe; add that, or leave it out")
    if arguments.probe and arguments.reuse:
        raise ConfigurationError("--probe forecasts a run that takes nothing over; leave --reuse out")


def _print_json(
    spec: "CheckedSpec",
    steps: "list[PlannedStep]",
    parts: "dict[str, list[PlannedPart]]",
    forecast: "Forecast | None",
) -> None:
    each = [asdict(step) | _reuse_as_json(parts.get(step.step)) for step in steps]
    document: dict[str, object] = {"schema_version": 1, "name": spec.name, "steps": each}
    if forecast is not None:
        document["forecast"] = {**forecast.model_dump(mode="json", exclude_none=True), "cpu_hours": forecast.cpu_hours}
    sys.stdout.write(json.dumps(document, indent=2) + "\n")


def _print_text(
    arguments: argparse.Namespace,
    spec: "CheckedSpec",
    steps: "list[PlannedStep]",
    parts: "dict[str, list[PlannedPart]]",
    forecast: "Forecast | None",
) -> None:
    from ...output.forecast import forecast_lines
    from ...output.reuse import reuse_lines, reuse_total
    from ...planning import after, counted

    sys.stdout.write(f"{spec.name}: {counted(len(steps), 'step')}, one after the other\n\n")
    rows = [(str(number), step.step, step.operation, after(step)) for number, step in enumerate(steps, 1)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row, step in zip(rows, steps, strict=True):
        cells = "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        sys.stdout.write(f"  {cells}  {step.detail}".rstrip() + "\n")
        sys.stdout.writelines(f"       {line}\n" for line in reuse_lines(parts.get(step.step, [])))
    if arguments.reuse:
        sys.stdout.write(f"\n{reuse_total(parts)}\n")
    if forecast is not None:
        sys.stdout.write("\n" + "\n".join(forecast_lines(forecast)) + "\n")
    options = f"{' --reuse' if arguments.reuse else ''}{f' --backend {arguments.backend}' if arguments.backend else ''}"
    sys.stdout.write(f"\nrobomaker run {arguments.spec}{options}\n")


def _forecast(spec: "CheckedSpec", arguments: argparse.Namespace) -> "Forecast":
    """Runs a probe of the specification."""
    from .....schemas.specs.probe_requests import check_probed
    from ...output.progress import watcher
    from ...pipelines import settings_of
    from ...prefect_server import use_server
    from ...probing.machines import Machines
    from ...signals import interrupted_by_signals

    settings = settings_of(arguments)
    machines = Machines(1 if arguments.machines is None else arguments.machines, arguments.price_per_hour)
    machines.check(settings)
    check_probed(spec)
    use_server(settings)
    steps = [(name, spec.steps[name].operation) for name in spec.order]
    with interrupted_by_signals(), watcher(steps, os.environ) as listener:
        from ...probing.forecasts import probe

        return probe(spec, settings, machines, listener, arguments.spec)


def _reuse(spec: "CheckedSpec") -> "dict[str, list[PlannedPart]]":
    """Plans which parts a run would reuse, by step."""
    from .....schemas.settings import Settings
    from .....tasks.inspection.reuse_plans import plan_reuse
    from .....tasks.service.service import Service

    return plan_reuse(spec, Service.open(Settings.from_environment(os.environ)))


def _reuse_as_json(parts: "list[PlannedPart] | None") -> dict[str, object]:
    return {} if parts is None else {"parts": [asdict(part) for part in parts]}
