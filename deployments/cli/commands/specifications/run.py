"""Run a specification and report what came of it.

The exit code says how it ended; `robomaker --help` lists them. With `--against` it is the answer's, once the run came
to its end: 0 better, or with `--margin` not worse; 1 worse, 6 no difference shown, 7 not comparable, also where trials
fail; what broke or was cancelled goes first.
"""

import argparse
import dataclasses
import os
import sys
from typing import TYPE_CHECKING

from .....schemas.wire.errors import ConfigurationError
from ...arguments import add_backend, add_parameters, add_report, add_spec, given_options
from ...inputs.options import find_record, output_file, percentage, seed_number, spec_name

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .....schemas.reports.live_comparison import Against
    from .....schemas.settings import Settings
    from .....schemas.specs.parameter_values import ParameterValue
    from .....schemas.specs.specification import CheckedSpec


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker run` to its parser."""
    add_spec(parser)
    add_parameters(parser)
    parser.add_argument("--name", help="name of the run, in place of the specification's")
    parser.add_argument(
        "--seed", type=int, metavar="N", help="seed of worlds and simulations, in place of those in SPEC"
    )
    parser.add_argument(
        "--reuse", action="store_true", help="take over worlds and results of earlier runs that had the same inputs"
    )
    parser.add_argument(
        "--against",
        metavar="RUN",
        help="carry it out beside this earlier run, trial by trial, and stop when it is decided whether it is better",
    )
    parser.add_argument(
        "--alpha",
        type=float,
        metavar="P",
        help="with --against: error probability of all answers together (default: 0.05)",
    )
    parser.add_argument(
        "--margin",
        metavar="POINTS",
        help="with --against: fall of the pass rate, in percentage points, that would matter; it is decided, too, "
        "where the run is shown to have fallen by less",
    )
    add_backend(parser)
    add_report(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker run`: runs a specification to its end and prints a summary; the exit code says how it ended."""
    from .....tasks.nights.wanted_runs import WantedRun
    from ...specification_run import carry_out, settings_of

    spec = _chosen(arguments)
    settings = settings_of(arguments)
    against = _question(arguments, settings)
    report = output_file(arguments.report, "--report")
    if arguments.reuse:
        _say_why_nothing_is_reused(spec, settings)
    command = again(arguments, spec.parameters)
    wanted = WantedRun(spec, arguments.spec, command, reuse=arguments.reuse, against=against)
    return carry_out(wanted, settings, arguments, report=report)


def _question(arguments: argparse.Namespace, settings: "Settings") -> "Against | None":
    """Returns the earlier run that `--against` compares the new run with; `None` without the option.

    Raises:
        ConfigurationError: There is no such run, or a number is out of range, or stands for nothing.
    """
    if arguments.against is None:
        for name in ("alpha", "margin"):
            if getattr(arguments, name) is not None:
                raise ConfigurationError(f"--{name} is about --against, which is not given; name the earlier run")
        return None
    alpha = 0.05 if arguments.alpha is None else arguments.alpha
    if not 0 < alpha < 1:
        raise ConfigurationError(f"--alpha is {alpha:g}; it has to be above 0 and below 1, such as 0.05")
    margin = percentage(arguments.margin, "--margin")
    from .....schemas.reports.live_comparison import Against
    from .....tasks.inspection.run_records import ORDER_NAME

    runs = settings.home / "runs"
    if (runs / arguments.against / ORDER_NAME).is_file():
        raise ConfigurationError(f"--against is {arguments.against}, which has not ended; a run that has would do")
    record = find_record(runs, arguments.against)
    if record.parent.absolute().parent != runs.absolute():
        raise ConfigurationError(f"--against is {arguments.against}; the id of a run in {runs} would be right")
    arguments.against = record.parent.name  # the command that does the same again may not say `latest`
    return Against(run_id=arguments.against, alpha=alpha, margin=margin)


def _say_why_nothing_is_reused(spec: "CheckedSpec", settings: "Settings") -> None:
    from .....schemas.wire.errors import RobomakerError
    from .....tasks.inspection.reuse_plans import plan_reuse
    from .....tasks.service.service import Service
    from ...output.forecast import why_nothing

    try:
        line = why_nothing(plan_reuse(spec, Service.open(settings)))
    except RobomakerError:
        return  # the run says what is wrong, in its own words
    if line is not None:
        sys.stderr.write(f"{line}\n")


def again(arguments: argparse.Namespace, parameters: "Mapping[str, ParameterValue]") -> list[str]:
    """Returns the command line that repeats the same run.

    Args:
        arguments: Parsed arguments of the command.
        parameters: All values of the specification's parameters: defaults, and those in a file, may change.
    """
    from .....schemas.specs.parameter_values import set_options

    command = ["robomaker", "run", arguments.spec, *set_options(parameters)]
    command += given_options(arguments, "name", "seed", "against", "alpha", "margin", "backend", "report")
    return [*command, "--reuse"] if arguments.reuse else command


def _chosen(arguments: argparse.Namespace) -> "CheckedSpec":
    """Reads the specification, and replaces its name and seed by those of the options.

    Raises an error if the specification has problems, or a name or seed does not do.
    """
    from .....schemas.settings import Settings
    from .....schemas.specs.specification import with_seed
    from ...inputs.specifications import given_parameters, read_spec

    # Code may lie elsewhere, or be another, where jobs run on other machines; here it is what they will have.
    is_here = (arguments.backend or Settings.from_environment(os.environ).backend) == "local"
    spec = read_spec(arguments.spec, given_parameters(arguments), with_code=is_here)
    if arguments.name is not None:
        spec = dataclasses.replace(spec, name=spec_name(arguments.name))
    if arguments.seed is not None:
        spec = with_seed(spec, seed_number(arguments.seed, "--seed"))
    return spec
