"""Show the runs of a specification night by night, and write a page of it.

Without NAME it lists the specifications that have runs, with the newest run of each. The page has the pass rate of each
run with its interval, requirements, worlds, jobs that are unsteady, and since when each failure lasts and what changed
when it began.
"""

import argparse
import os
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from .....schemas.wire.errors import ConfigurationError
from ...arguments import add_open, add_output
from ...inputs.options import output_file
from ...output.answers import open_file, print_either

if TYPE_CHECKING:
    from .....tasks.inspection.run_records import FoundRecords

_MOST_TOLD = 3
"""Limit of the latest missed nights that are named if a specification has no run.

`robomaker doctor` has those of a week.
"""


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker history` to its parser."""
    parser.add_argument(
        "name",
        metavar="NAME",
        nargs="?",
        help="name of a specification, as in its file or after `run --name` (default: list those that have runs)",
    )
    parser.add_argument("--runs", type=int, default=100, metavar="N", help="look at the latest N runs (default: 100)")
    parser.add_argument("--to", metavar="FILE", help="put the page there (default: history/NAME.html in the data home)")
    add_output(parser, "text", "json")
    add_open(parser, "show the page in a browser")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker history`: prints the history of a specification's runs and writes its page.

    Without a name it lists the specifications that have runs.
    Runs that cannot be read are named on standard error. Raises ConfigurationError if no run can be shown, or
    `--runs` is below 1.
    """
    from .....schemas.settings import Settings

    if arguments.runs < 1:
        raise ConfigurationError(f"--runs is {arguments.runs}; it has to be a number from 1")
    settings = Settings.from_environment(os.environ)
    home = settings.home
    if arguments.name is None:
        return _list(arguments, home / "runs")
    # A name is no path, whatever it is.
    page = output_file(arguments.to, "--to") or home / "history" / f"{Path(arguments.name).name}.html"

    from .....tasks.comparison.compared_runs import NightRun
    from .....tasks.comparison.history import history_of
    from .....tasks.inspection.run_records import find_records
    from .....tasks.nights.broken_off import unfinished_nights
    from .....tasks.nights.missed_nights import missed_nights
    from .....tasks.reporting import write_history
    from ...output.comparison import history_lines

    found = find_records(home / "runs", arguments.name, arguments.runs)
    for problem in found.unreadable:
        sys.stderr.write(f"robomaker: left out: {problem}\n")
    gaps = [*missed_nights(home, arguments.name), *unfinished_nights(settings, arguments.name)]
    if not found.records:
        told = [night.in_words() for night in gaps if not night.has_begun]
        raise ConfigurationError("; ".join([_nothing(arguments.name, home / "runs", found), *told[-_MOST_TOLD:]]))
    history = history_of(arguments.name, [NightRun.of(record) for record in found.records], found.left_out)
    # Nights before the first run that is shown are of runs that are left out; else none had begun before it.
    first = found.records[0].started_at if found.left_out else datetime.min.replace(tzinfo=UTC)
    missed = sorted((night for night in gaps if night.due_at >= first), key=lambda night: night.due_at)
    history = history.model_copy(update={"missed": missed})
    path = write_history(history, page)
    print_either(arguments.output, history, history_lines(history, path))
    if arguments.open:
        open_file(path)
    return 0


def _list(arguments: argparse.Namespace, runs: Path) -> int:
    """Prints the specifications that have runs, with the newest run of each.

    Raises ConfigurationError if an option is given that is for one specification.
    """
    for option, given in (("--to", arguments.to is not None), ("--open", arguments.open)):
        if given:
            raise ConfigurationError(f"{option} is for the page of one specification; name that")

    from .....tasks.comparison.compared_runs import NightRun
    from .....tasks.comparison.history import newest_night
    from .....tasks.inspection.run_records import find_records, names_of_specifications
    from ...output.comparison import newest_lines

    newest = {}
    for name in names_of_specifications(runs):
        found = find_records(runs, name, 1)
        for problem in found.unreadable:
            sys.stderr.write(f"robomaker: left out: {problem}\n")
        if found.records:
            newest[name] = newest_night(NightRun.of(found.records[-1]))
    listed = [{"name": name, **night.model_dump(mode="json", by_alias=True)} for name, night in newest.items()]
    nothing = f"there are no runs in {runs} yet; `robomaker run SPEC` makes one"
    print_either(arguments.output, {"schema_version": 1, "specifications": listed}, newest_lines(newest) or [nothing])
    return 0


def _nothing(name: str, runs: Path, found: "FoundRecords") -> str:
    """Says why a specification has no history: no run of it can be read, none is a night, or there is none."""
    from .....tasks.inspection.run_records import find_records, names_of_specifications

    if found.unreadable:
        return f"no run of {name!r} in {runs} can be read"
    names = names_of_specifications(runs)
    if name in names:
        words = "challenges, probes and reruns of some jobs are none"
        return f"no run of {name!r} in {runs} is a night: {words}; `robomaker report RUN` shows one"
    known = [each for each in names if find_records(runs, each, 1).records]
    there = f"there are runs of {', '.join(known)}" if known else "there are none yet; `robomaker run SPEC` makes one"
    return f"there is no run of {name!r} in {runs}; {there}"
