"""Compare two runs trial by trial: is the second one better or worse?

Jobs are paired by step, world and seed, and their trials by seed and axes. The answer is that of the exact
McNemar test of the pairs that were judged in both runs, or where six worlds or more have several trials, of a test
that flips whole worlds. It is also the exit code: 0 better, or with `--margin` not worse, 1 worse, 6 no difference
shown, 7 not comparable. `--axis` compares two values of an axis within one run instead. `--report` writes both side by
side as a page: paths on one plan, videos in step, and what changed in each requirement.
"""

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from .....schemas.wire.errors import ConfigurationError
from ...arguments import add_open, add_output
from ...inputs.options import find_record, open_service, output_file, percentage
from ...output.answers import open_file, print_either

if TYPE_CHECKING:
    from .....schemas.reports.run_record import RunRecord
    from .....tasks.comparison.side_by_side import StepAxis
    from ....compared_pages import Sides


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker compare` to its parser."""
    parser.add_argument("before", metavar="A", help="id of the run to compare with; with --axis, the only run")
    parser.add_argument(
        "after",
        metavar="B",
        nargs="?",
        help="id of the run that may be better, its specification's name, or latest (default: A, compared with the run "
        "before it)",
    )
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
    parser.add_argument(
        "--axis",
        metavar="[STEP.]NAME=VALUE",
        help="compare the first value of an axis of run A with another one, such as robot=rover",
    )
    parser.add_argument("--report", metavar="FILE", help="write both side by side as an HTML page")
    add_output(parser, "text", "json")
    add_open(parser, "show the page of --report in a browser")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker compare`: compares two runs, or two values of an axis; the exit code tells which one is better.

    Writes a page of both side by side with `--report`. Raises ConfigurationError if options do not go together, or if
    both names are of one run.
    """
    from .....schemas.settings import Settings

    difference, margin = _shares(arguments)
    page = output_file(arguments.report, "--report")
    if arguments.open and page is None:
        raise ConfigurationError("--open shows the page of --report; name its file, such as --report compared.html")
    runs = Settings.from_environment(os.environ).home / "runs"
    if arguments.axis is not None:
        return _compare_cells(arguments, runs, page)
    from .....tasks.comparison.better_or_worse import compare
    from .....tasks.comparison.compared_runs import NightRun
    from .....tasks.inspection.run_records import read_record
    from ...output.comparison import comparison_lines

    if arguments.after is None:
        before, after = _with_run_before(find_record(runs, arguments.before))
    else:
        before, after = (read_record(find_record(runs, run)) for run in (arguments.before, arguments.after))
    if before.run_id == after.run_id:
        raise ConfigurationError(f"both runs are {before.run_id}; name two")
    comparison = compare(
        NightRun.of(before), NightRun.of(after), alpha=arguments.alpha, difference=difference, margin=margin
    )
    told = []
    if page is not None:
        from ....compared_pages import Sides

        told = _write(Sides.of_runs(before, after, comparison), page, arguments.open)
    print_either(arguments.output, comparison, [*comparison_lines(comparison), *told])
    return comparison.exit_code


def _with_run_before(path: Path) -> "tuple[RunRecord, RunRecord]":
    """Returns the run that reports compare a run with, and the run itself.

    Raises:
        ConfigurationError: No earlier run of its specification has results.
    """
    from .....tasks.comparison.compared_runs import NightRun
    from .....tasks.inspection.run_records import read_record, since_last

    record = read_record(path)
    runs = record.run_dir.parent
    previous = since_last(NightRun.of(record), runs).previous_run_id
    if previous is None:
        raise ConfigurationError(
            f"B is missing, and no run of {record.name} before {record.run_id} has results; name the run that may be "
            "better, or a value of an axis with --axis"
        )
    return read_record(find_record(runs, previous)), record


def _compare_cells(arguments: argparse.Namespace, runs: Path, page: Path | None) -> int:
    """Compares the first value of an axis with another one within a run; returns the exit code of the answer.

    The answer is printed, and written as a page if `page` is given. Raises ConfigurationError if an option is given
    that is for two runs.
    """
    wrong = next((name for name in ("after", "difference", "margin") if getattr(arguments, name) is not None), None)
    if wrong is not None:
        given = "B" if wrong == "after" else f"--{wrong}"
        raise ConfigurationError(f"{given} is for two runs, and --axis compares two values within one; leave one out")
    if arguments.alpha != 0.05:  # that of the run's report, whose answer is given
        raise ConfigurationError("--alpha is for two runs; the values of an axis are compared at 0.05, as in reports")
    path = find_record(runs, arguments.before)

    from .....schemas.reports.report import ArmComparison
    from .....schemas.reports.run_exit_codes import ANSWER_EXIT_CODES
    from .....tasks.comparison.arms import axis_results
    from .....tasks.comparison.compared_runs import NightRun
    from .....tasks.inspection.job_outputs import digests_of
    from .....tasks.inspection.run_records import read_record
    from ....compared_pages import Sides
    from ...output.comparison import arm_lines

    record = read_record(path)
    axis, other = _cell(arguments.axis, record)
    results = axis_results(NightRun.of(record), digests_of(record.jobs, open_service()), between_worlds=True)
    found = next((each for each in results if (each.step, each.axis) == (axis.step, axis.name)), None)
    arms = {each.value: each for each in found.comparisons} if found else {}
    sides = Sides.of_cells(record, axis, 0, other)
    arm = arms.get(axis.titles[other]) or ArmComparison(
        baseline=axis.titles[0], value=axis.titles[other], answer="not comparable",
        why=(found and found.note) or "they have no pairs", pairs=0, unpaired=len(sides.before.alone),
        unjudged=0, other_requirements=0,
    )  # fmt: skip
    told = _write(sides, page, arguments.open) if page is not None else []
    print_either(arguments.output, arm, [*arm_lines(record.run_id, axis.name, arm), *told])
    return ANSWER_EXIT_CODES[arm.answer]


def _cell(given: str, record: "RunRecord") -> tuple["StepAxis", int]:
    """Returns the axis that an option names, and the index of its value.

    Raises:
        ConfigurationError: The run has no such axis or value, several steps have one, or several values look alike.
    """
    from .....schemas.wire.common import counted
    from .....tasks.comparison.side_by_side import axes_of

    axes = axes_of(record.jobs)
    name, _, value = given.partition("=")
    found = [axis for axis in axes if name in (axis.name, f"{axis.step}.{axis.name}")]
    if len(found) != 1:
        known = ", ".join(f"{axis.step}.{axis.name}" for axis in axes) or "none of two values or more"
        problem = f"is of {counted(len(found), 'step')}" if found else "is no axis"
        raise ConfigurationError(f"--axis is {given!r}: {name!r} {problem} of {record.run_id}; it has {known}")
    [axis] = found
    if value not in axis.titles[1:]:
        raise ConfigurationError(
            f"--axis is {given!r}: {value!r} is no value beside the first one, {axis.titles[0]}; "
            f"{', '.join(axis.titles[1:])} would be right"
        )
    if axis.titles[1:].count(value) > 1:  # a number and a text, of which nothing says which one is meant
        raise ConfigurationError(
            f"--axis is {given!r}: several values of {name} look like {value!r}; the console shows each side by side"
        )
    return axis, axis.titles.index(value, 1)


def _write(sides: "Sides", page: Path, opens: bool) -> list[str]:
    """Writes both sides as a page, opens it if asked, and returns the line that names it."""
    from .....tasks.reporting import write_comparison
    from ....compared_pages import compared_file

    path = write_comparison(compared_file(sides, open_service(), page), page)
    if opens:
        open_file(path)
    return [f"  page          {path}"]


def _shares(arguments: argparse.Namespace) -> tuple[float | None, float | None]:
    """Checks the options' numbers, and returns difference and margin as shares of 1.

    Raises:
        ConfigurationError: Alpha, difference or margin is out of range, or both difference and margin are given.
    """
    if not 0 < arguments.alpha < 1:
        raise ConfigurationError(f"--alpha is {arguments.alpha:g}; it has to be above 0 and below 1, such as 0.05")
    if arguments.margin is not None and arguments.difference is not None:
        raise ConfigurationError("--difference and --margin ask for different numbers of pairs; leave one out")
    return percentage(arguments.difference, "--difference", whole=True), percentage(arguments.margin, "--margin")
