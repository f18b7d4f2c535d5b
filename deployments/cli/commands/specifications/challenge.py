"""Sabotage the robots of a specification, and see which sabotages its requirements catch.

A few of SPEC's simulation jobs run again and again in the same worlds with the same seeds: once as they are, and once
with each sabotage: a robot that does nothing, one that is blind, one whose commands come late, and so on. A sabotage
that no job notices is a fault that SPEC would let pass. Of a job with trials the first one runs.

The exit code is 0 if each sabotage that can be applied was caught by a job, some by a requirement, and 1 if not.
"""

import argparse
import dataclasses
from typing import TYPE_CHECKING

from .....schemas.wire.errors import ConfigurationError
from ...arguments import add_backend, add_parameters, add_report, add_spec, given_options
from ...inputs.options import output_file

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .....schemas.specs.parameter_values import ParameterValue
    from .....schemas.specs.sabotages import Sabotage

_JOBS = 3
_LONGEST_NAME = 90
"""Longest specification name that is kept in the challenge's name, in characters.

`-challenge` is appended, and 100 characters are the limit.
"""


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker challenge` to its parser."""
    add_spec(parser)
    add_parameters(parser)
    parser.add_argument(
        "--jobs", type=int, default=_JOBS, metavar="N", help=f"how many of the jobs are challenged (default: {_JOBS})"
    )
    parser.add_argument(
        "--sabotages",
        metavar="FILE",
        help="sabotages besides those in SPEC: YAML, such as slippery: {robot_friction: 0.2}",
    )
    add_backend(parser)
    add_report(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker challenge`: runs sabotaged jobs; the exit code says whether requirements catch all sabotages.

    The run is named after the specification with `-challenge`, and sends no notifications. Raises ConfigurationError
    if `--jobs` is below 1.
    """
    from .....schemas.reports.challenge import Challenge, SabotageResult
    from .....schemas.specs.challenge_requests import ChallengeCut, challenged_spec
    from .....schemas.specs.sabotages import BUILT_IN, distinct
    from .....tasks.nights.wanted_runs import WantedRun
    from ...inputs.specifications import given_parameters, read_spec
    from ...specification_run import carry_out, settings_of

    if arguments.jobs < 1:
        raise ConfigurationError(f"--jobs is {arguments.jobs}; a number from 1 would be right")
    given = read_spec(arguments.spec, given_parameters(arguments))
    sabotages = distinct([*BUILT_IN, *given.sabotages, *_own(arguments.sabotages)])
    spec = challenged_spec(given, arguments.jobs)
    settings = settings_of(arguments).model_copy(update={"notify": ()})
    report = output_file(arguments.report, "--report")
    wanted = WantedRun(
        dataclasses.replace(spec, name=f"{spec.name[:_LONGEST_NAME]}-challenge"),
        arguments.spec,
        again(arguments, spec.parameters),
        cut=ChallengeCut.of(spec, sabotages, arguments.jobs),
        challenge=Challenge(sabotages=[SabotageResult(name=each.name, axes=each.axes) for each in sabotages]),
    )
    return carry_out(wanted, settings, arguments, report=report)


def again(arguments: argparse.Namespace, parameters: "Mapping[str, ParameterValue]") -> list[str]:
    """Returns the command line that repeats the same challenge."""
    from .....schemas.specs.parameter_values import set_options

    command = ["robomaker", "challenge", arguments.spec, *set_options(parameters)]
    return command + given_options(arguments, "jobs", "sabotages", "backend", "report")


def _own(path: str | None) -> "list[Sabotage]":
    from .....schemas.specs.sabotages import parse_sabotages
    from .....schemas.specs.yaml_nodes import parse
    from ...inputs.specifications import read_text

    return [] if path is None else parse_sabotages(parse(read_text(path), path))
