"""Parses values of command line options: a person, a time span, an output file, an earlier run; opens the service."""

import getpass
import json
import os
import re
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from ....schemas.wire.errors import ConfigurationError

if TYPE_CHECKING:
    from ....schemas.reports.run_record import RunRecord
    from ....tasks.service.service import Service


def who(given: str | None) -> str:
    """Returns the name of the person who decides: as given, else the operating system's user.

    Args:
        given: Name on the command line; empty: the operating system's user.
    """
    if given:
        return given
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container's user need not have a name
        return "a person without a name"


_UNITS = {"w": "weeks", "d": "days", "h": "hours", "m": "minutes", "s": "seconds"}
_LONGEST = timedelta(days=36500)


def time_span(text: str, option: str) -> timedelta:
    """Parses a time span such as `2w 3d`.

    Args:
        text: Numbers with units, the largest first: w, d, h, m, s.
        option: Name of the option, for the error message.

    Raises:
        ConfigurationError: The text is not a time span.
    """
    if re.fullmatch(r"(\d{1,5}w)?(\d{1,5}d)?(\d{1,5}h)?(\d{1,5}m)?(\d{1,5}s)?", text) and text:
        total = timedelta(**{_UNITS[unit]: int(number) for number, unit in re.findall(r"(\d+)([wdhms])", text)})
        if total <= _LONGEST:
            return total
    raise ConfigurationError(f"{option} is {text!r}; a time such as 30d, 12h or 1d12h would be right")


def percentage(text: str | None, option: str, *, whole: bool = False, none: bool = False) -> float | None:
    """Parses percentage points such as `5` or `5points`, and returns them as a share.

    Args:
        text: A number, with or without `points` behind it; None: nothing was given.
        option: Name of the option, for the error message.
        whole: Whether 100 is allowed, too.
        none: Whether 0 is allowed, too.

    Returns:
        The share: 0.05 for `5`; None: nothing was given.

    Raises:
        ConfigurationError: The text is not a number of percentage points, or is out of range.
    """
    if text is None:
        return None
    found = re.fullmatch(r"(\d+(?:\.\d+)?) ?(?:points?|%)?", text)
    points = float(found[1]) if found else -1.0
    if not (0 < points < 100 or (whole and points == 100) or (none and points == 0)):
        least, most = "from 0" if none else "above 0", "at most 100" if whole else "below 100"
        raise ConfigurationError(f"{option} is {text!r}; a number {least} and {most}, such as 5, would be right")
    return points / 100


def output_file(path: str | None, option: str) -> Path | None:
    """Checks an output file's path, and makes it absolute.

    Args:
        path: Path that the user gave; None: none was given.
        option: Name of the option, for the error message.

    Raises:
        ConfigurationError: The path is that of a folder, or its folder does not exist.
    """
    if path is None:
        return None
    file = Path(path).absolute()
    if not path or "\0" in path or file.is_dir() or not file.parent.is_dir():
        raise ConfigurationError(f"{option} is {path}; it has to be a file in a folder that exists")
    return file


def spec_name(given: str, option: str = "--name") -> str:
    """Checks the name that an option gives a specification, and returns it.

    Args:
        given: The name.
        option: Name of the option, for the error message.

    Raises:
        ConfigurationError: The text is not a valid name.
    """
    from ....schemas.specs.specification import is_spec_name

    if not is_spec_name(given):
        raise ConfigurationError(f"{option} is {given!r}; letters, digits, - and _ would be right")
    return given


def seed_number(given: int, option: str) -> int:
    """Checks the seed that an option gives a run, and returns it.

    Args:
        given: The seed.
        option: Name of the option, for the error message.

    Raises:
        ConfigurationError: The seed is out of range.
    """
    from ....schemas.wire.common import MAX_SEED

    if not 0 <= given <= MAX_SEED:
        raise ConfigurationError(f"{option} is {given}; it has to be a whole number from 0 to {MAX_SEED}")
    return given


def open_service() -> "Service":
    """Opens the RoboMaker service that the environment variables describe.

    Raises:
        ConfigurationError: A setting leads nowhere.
        StorageError: The object store does not answer.
    """
    from ....schemas.settings import Settings
    from ....tasks.service.service import Service

    return Service.open(Settings.from_environment(os.environ))


def find_record(runs: Path, run: str) -> Path:
    """Finds the record file of a run.

    Args:
        runs: Folder of all runs.
        run: A run's id or its beginning, its folder, the name of a specification, which means its newest run, or
            `latest`. Both leave the probes of forecasts out.

    Raises:
        ConfigurationError: The run does not exist, or the beginning is that of several.
    """
    if "/" in run and (record := Path(run) / "run.json").is_file():
        return record
    from ....schemas.reports.names import ambiguous, near_names, newest_first, runs_meant, specification_of

    records = newest_first(runs.glob("*/run.json"))
    if not records:
        raise ConfigurationError(f"there are no runs in {runs} yet; `robomaker run SPEC` makes one")
    if run == "latest":
        return next((record for record in records if not _is_probe(record)), records[0])
    names = [path.parent.name for path in records]
    found = runs_meant(run, names, lambda name: _is_probe(runs / name / "run.json"))
    if len(found) == 1:
        return runs / found[0] / "run.json"
    if found:
        raise ConfigurationError(ambiguous(run, f"runs in {runs}", found))
    latest = ", ".join(names[:5])
    near = near_names(run, [*map(specification_of, names), *names])
    raise ConfigurationError(f"there is no run {run!r} in {runs}; the latest are {latest}{near}")


def find_run(runs: Path, run: str) -> Path:
    """Finds the folder of a run, which may not have ended.

    Args:
        runs: Folder of all runs.
        run: As for `find_record`; a specification's name and `latest` also mean a run that began later and has no
            record yet.

    Raises:
        ConfigurationError: The run does not exist.
    """
    if "/" in run and (Path(run) / "order.json").is_file():
        return Path(run)
    unfinished = {path.parent.name: path.parent for path in runs.glob("*/order.json")}
    if run in unfinished:
        return unfinished[run]
    from ....schemas.reports.names import began, specification_of

    newest = max((each for each in unfinished if run in ("latest", specification_of(each))), key=began, default="")
    try:
        ended = find_record(runs, run).parent
    except ConfigurationError:
        if newest:
            return unfinished[newest]
        raise
    # A specification's name also begins the names of others: what goes on under the name itself is meant before those.
    is_others = run != "latest" and specification_of(ended.name) != run
    return unfinished[newest] if newest and (is_others or began(newest) > began(ended.name)) else ended


def _is_probe(record: Path) -> bool:
    try:
        return bool(json.loads(record.read_bytes()).get("probe"))
    except ValueError:
        return False  # who reads it is told what is wrong with it


def read_record(runs: Path, run: str) -> "RunRecord":
    """Reads the record of a run; see `find_record`.

    Raises:
        ConfigurationError: The run does not exist, or its record cannot be read.
    """
    record = find_record(runs, run)
    from ....tasks.inspection import run_records

    return run_records.read_record(record)
