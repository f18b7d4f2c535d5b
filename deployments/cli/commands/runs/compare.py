"""Compare two runs trial by trial: is the second one better or worse?

Jobs are paired by step, world and seed, and their trials by seed and axes. The answer is that of the exact
McNemar test of the pairs that were judged in both runs, or where six worlds or more have several trials, of a test
that flips whole worlds. It is also the exit code: 0 better, or with `--margin` not worse, 1 worse, 6 no difference
shown, 7 not comparable.
"""

import argparse
import os

from .....schemas.wire.errors import ConfigurationError
from ...arguments import add_output
from ...inputs.options import find_record, percentage
from ...output.answers import print_either


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker compare` to its parser."""
    parser.add_argument("before", metavar="A", help="id of the run to compare with")
    parser.add_argument("after", metavar="B", help="id of the run that may be better, or latest")
    parser.add_argument(
        "--alpha",
        type=float,
        default=0.05,
        metavar="P",
        help="error probability: how often a difference is shown where there is none (default: 0.05)",
    )
    parser.add_argument(
        "--difference",
        metavar="POINTS",
        help="difference of pass rates, in percentage points, that the number of needed pairs is about (default: the "
        "one found, or 10)",
    )
    parser.add_argument(
        "--margin",
        metavar="POINTS",
        help="fall of the pass rate, in percentage points, that would matter: B is not worse, exit code 0, where it is "
        "shown to have fallen by less",
    )
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker compare`: compares two runs; the exit code tells whether the second is better or worse."""
    from .....schemas.settings import Settings

    difference, margin = _shares(arguments)
    runs = Settings.from_environment(os.environ).home / "runs"
    files = [find_record(runs, run) for run in (arguments.before, arguments.after)]

    from .....tasks.comparison.better_or_worse import compare
    from .....tasks.comparison.compared_runs import NightRun
    from .....tasks.inspection.run_records import read_record
    from ...output.comparison import comparison_lines

    before, after = (NightRun.of(read_record(file)) for file in files)
    if before.run_id == after.run_id:
        raise ConfigurationError(f"both runs are {before.run_id}; name two")
    comparison = compare(before, after, alpha=arguments.alpha, difference=difference, margin=margin)
    print_either(arguments.output, comparison, comparison_lines(comparison))
    return comparison.exit_code


def _shares(arguments: argparse.Namespace) -> tuple[float | None, float | None]:
    """Checks the options' numbers, and returns difference and margin as shares of 1.

    Raises:
        ConfigurationError: alpha, difference or margin is out of range, or both difference and margin are given.
    """
    if not 0 < arguments.alpha < 1:
        raise ConfigurationError(f"--alpha is {arguments.alpha:g}; it has to be above 0 and below 1, such as 0.05")
    if arguments.margin is not None and arguments.difference is not None:
        raise ConfigurationError("--difference and --margin ask for different numbers of pairs; leave one out")
    return percentage(arguments.difference, "--difference", whole=True), percentage(arguments.margin, "--margin")
