"""Show the steps of a specification in the order they would run.

Runs nothing, except with `--probe`. With `--reuse` it says of each world and each simulation job whether `robomaker
run --reuse` would take it over from an earlier run, and if not, why: what is new, or which input has changed.

With `--probe` it runs a few worlds, a job of each step and a few of its trials, and says what the whole run will take:
wall time, CPU hours, bytes and, given a price, cost. The next run of SPEC says how far off that was.

With `--detect` or `--margin` it says how many trials two runs of SPEC need so that `robomaker compare` shows a
difference of so many points, or that nothing got worse by so many, with a chance of 80 %. With `--against` besides, the
second run is one that stops when it is decided: how many trials it has to have, and when it stops.
"""

import argparse
import os
import shlex
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Literal

from .....schemas.wire.errors import ConfigurationError
from ...arguments import add_backend, add_output, add_parameters, add_spec, given_options
from ...inputs.options import open_service, percentage
from ...output.answers import in_columns, print_either, print_notes

if TYPE_CHECKING:
    from .....schemas.reports.comparison import AxisPairs, PlannedPairs
    from .....schemas.reports.forecast import Forecast
    from .....schemas.specs.specification import CheckedSpec
    from .....tasks.comparison.detection import Question
    from .....tasks.inspection.reuse_plans import PlannedPart
    from ...planning import PlannedStep

    NeededTrials = tuple[PlannedPairs, list[str]]
    """Trials that answer a question, and the ways to get them."""


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker plan` to its parser."""
    add_spec(parser)
    add_parameters(parser)
    parser.add_argument("--reuse", action="store_true", help="say what a run with --reuse would run, and why")
    parser.add_argument("--probe", action="store_true", help="run one job of each step and forecast the whole run")
    parser.add_argument("--machines", metavar="N", type=int, help="machines of the backend; for --probe (default: 1)")
    parser.add_argument(
        "--price-per-hour", metavar="P", type=float, help="price of a machine for an hour, in any currency; for --probe"
    )
    parser.add_argument("--detect", metavar="POINTS", help="say how many trials show a difference of pass rates")
    parser.add_argument("--margin", metavar="POINTS", help="say how many trials show that nothing got worse by more")
    parser.add_argument(
        "--against",
        action="store_true",
        help="the second run stops when it is decided (`run --against`); for --detect and --margin",
    )
    parser.add_argument(
        "--differ",
        metavar="PERCENT",
        help="share of trials whose verdict will differ between the two runs; for --detect and --margin (default: as "
        "in earlier runs of SPEC, or 20)",
    )
    parser.add_argument(
        "--alpha", type=float, metavar="P", help="error probability of the comparison; for --detect and --margin"
    )
    add_backend(parser)
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker plan`: prints the steps of a specification without running them.

    With `--probe` one job of each step is run, to forecast time, disk space and cost.
    """
    from ...inputs.specifications import given_parameters, read_spec
    from ...planning import pairs_of_axes, planned

    _check(arguments)
    asked = _questions(arguments)
    spec = read_spec(arguments.spec, given_parameters(arguments), with_code=True)
    print_notes(spec.notes)
    steps = planned(spec)
    parts = _reuse(spec) if arguments.reuse else {}
    forecast = _forecast(spec, arguments) if arguments.probe else None
    needed = _needed(spec, steps, asked, forecast) if asked else []
    document = _document(spec, steps, parts, forecast)
    if needed:
        document["needed"] = [each.model_dump(mode="json", exclude_none=True) for each, _ in needed]
    axes = pairs_of_axes(spec, steps) if arguments.detect else []
    if axes:
        document["axes"] = [each.model_dump(mode="json") for each in axes]
    print_either(arguments.output, document, _lines(arguments, spec, steps, parts, forecast, needed, axes))
    return 0


def _questions(arguments: argparse.Namespace) -> "list[Question]":
    """Returns the statistical questions of `--detect` and `--margin`; an empty list if neither is given.

    Raises ConfigurationError if options do not go together or are out of range.
    """
    shares = {
        "difference": percentage(arguments.detect, "--detect", whole=True),
        "margin": percentage(arguments.margin, "--margin"),
    }
    if arguments.against and not any(shares.values()):
        raise ConfigurationError("--against is for --detect and --margin; add one, or leave it out")
    if not any(shares.values()):
        for option in ("differ", "alpha"):
            if getattr(arguments, option) is not None:
                raise ConfigurationError(f"--{option} is for --detect and --margin; add one, or leave it out")
        return []
    alpha = 0.05 if arguments.alpha is None else arguments.alpha
    if not 0 < alpha < 1:
        raise ConfigurationError(f"--alpha is {alpha:g}; it has to be above 0 and below 1, such as 0.05")

    from .....tasks.comparison.detection import Question

    differ = percentage(arguments.differ, "--differ", whole=True, none=True)
    if differ is not None and (shares["difference"] or 0) > differ:
        raise ConfigurationError(
            f"--detect is {arguments.detect} and --differ {arguments.differ}; pass rates cannot differ by more than "
            "the share of trials that differ"
        )
    kinds: tuple[Literal["difference", "margin"], ...] = ("difference", "margin")
    return [Question(kind, share, alpha, differ, stops=arguments.against) for kind in kinds if (share := shares[kind])]


def _needed(
    spec: "CheckedSpec", steps: "list[PlannedStep]", asked: "list[Question]", forecast: "Forecast | None"
) -> "list[NeededTrials]":
    """Plans the number of trials that answers each question, by earlier runs, and with times if a forecast is given.

    With each come the numbers of the specification that would give a run so many.
    """
    from .....schemas.settings import Settings
    from .....tasks.comparison.compared_runs import NightRun
    from .....tasks.comparison.detection import liveliest_pairs, plan_pairs
    from .....tasks.inspection.run_records import find_records
    from ...planning import planned_trials_of, ways_to_more, with_time

    settings = Settings.from_environment(os.environ)
    records = find_records(settings.home / "runs", spec.name).records
    earlier = liveliest_pairs([NightRun.of(each) for each in records], asked[0].alpha)
    planned = planned_trials_of(spec, steps)
    found: list[NeededTrials] = []
    for question in asked:
        needed, ways = plan_pairs(question, planned, earlier), list[str]()
        if planned is not None:
            again = partial(plan_pairs, question, earlier=earlier)
            ways = ways_to_more(spec, planned, needed, again, settings.max_worlds_per_job)
            needed = needed if forecast is None else with_time(needed, forecast, planned.trials)
        found.append((needed, ways))
    return found


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
    if spec.parameters:
        document["parameters"] = dict(spec.parameters)
    if forecast is not None:
        document["forecast"] = {**forecast.model_dump(mode="json", exclude_none=True), "cpu_hours": forecast.cpu_hours}
    return document


def _lines(
    arguments: argparse.Namespace,
    spec: "CheckedSpec",
    steps: "list[PlannedStep]",
    parts: "dict[str, list[PlannedPart]]",
    forecast: "Forecast | None",
    needed: "list[NeededTrials]",
    axes: "list[AxisPairs]",
) -> Iterator[str]:
    from .....schemas.specs.parameter_values import set_options
    from .....schemas.wire.common import counted
    from ...output.forecast import axis_lines, forecast_lines, needed_lines, reuse_lines, reuse_total
    from ...planning import after, sum_in_words

    yield f"{spec.name}: {counted(len(steps), 'step')}, one after the other\n"
    rows = [(str(number), step.step, step.operation, after(step), step.detail) for number, step in enumerate(steps, 1)]
    for line, step in zip(in_columns(rows), steps, strict=True):
        yield f"  {line}"
        yield from (f"       {line}" for line in reuse_lines(parts.get(step.step, [])))
    if total := sum_in_words(steps):
        yield f"\n{total}"
    if arguments.reuse:
        yield f"\n{reuse_total(parts)}"
    if forecast is not None:
        yield "\n" + "\n".join(forecast_lines(forecast))
    for each, ways in needed:
        yield "\n" + "\n".join(needed_lines(each, ways))
    if axes:
        yield "\n" + "\n".join(axis_lines(axes))
    command = ["robomaker", "run", arguments.spec, *set_options(spec.parameters)]
    command += [*(["--reuse"] if arguments.reuse else []), *given_options(arguments, "backend")]
    yield f"\n{shlex.join(command)}"


def _forecast(spec: "CheckedSpec", arguments: argparse.Namespace) -> "Forecast":
    """Runs one job of each step of the specification, and forecasts the whole run from them.

    Raises an error if the machines or the specification do not allow that.
    """
    from .....schemas.reports.progress import Note
    from .....schemas.specs.probe_requests import check_probed
    from ...output.progress import watcher
    from ...prefect_server import use_server, wait_for_server_once
    from ...probes import Machines, probe
    from ...signals import interrupted_by_signals
    from ...specification_run import settings_of

    settings = settings_of(arguments)
    machines = Machines(1 if arguments.machines is None else arguments.machines, arguments.price_per_hour)
    machines.check(settings)
    check_probed(spec)
    api_url = use_server(settings, for_runs=True)
    steps = [(name, spec.steps[name].operation) for name in spec.order]
    with interrupted_by_signals(), watcher(steps, os.environ) as listener:
        wait_for_server_once(api_url, settings, lambda text: listener(Note(text)))
        return probe(spec, settings, machines, listener, arguments.spec)


def _reuse(spec: "CheckedSpec") -> "dict[str, list[PlannedPart]]":
    """Plans which parts a run would reuse, by step."""
    from .....tasks.inspection.reuse_plans import plan_reuse

    return plan_reuse(spec, open_service())


def _reuse_as_json(parts: "list[PlannedPart] | None") -> dict[str, object]:
    return {} if parts is None else {"parts": [asdict(part) for part in parts]}
