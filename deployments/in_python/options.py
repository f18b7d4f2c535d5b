"""Options of `run`, which are validated before anything starts, as Python accepts values of any type."""

import operator
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...schemas.wire.errors import ConfigurationError
from ...tasks.backends.backend import open_backend
from ..cli.inputs.options import output_file, seed_number, spec_name


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of the Python function `run`, the same as those of the command `robomaker run`."""

    backend: str | None = None
    """Backend for jobs of batches, instead of ROBOMAKER_BACKEND: `local`, `workers:POOL`, …; `None`: that setting."""
    name: str | None = None
    """Name of the run, in place of the specification's."""
    seed: int | None = None
    """Seed of worlds and simulations, in place of those in the specification."""
    reuse: bool = False
    """Whether worlds and results of earlier runs with the same inputs are reused."""
    report: str | os.PathLike[str] | None = None
    """Path of a file for a copy of the report."""
    shows_progress: bool = True
    """Whether progress is shown on standard error."""

    def __post_init__(self) -> None:
        """Refuses values that no run could have.

        Raises:
            ConfigurationError: An option has an invalid value; the message names it and says what would be right.
        """
        for option in ("reuse", "shows_progress"):
            if not isinstance(value := getattr(self, option), bool):
                raise ConfigurationError(f"{option} is {value!r}; True or False would be right")
        if self.name is not None:
            spec_name(_text(self.name, "name", "letters, digits, - and _"), "name")
        if self.backend is not None:
            _check_backend(_text(self.backend, "backend", "a text such as 'local'"))
        _seed(self.seed)
        if self.report is not None:
            _path(self.report, "report", "the path of a file")


def checked_options(given: Any) -> RunOptions:
    """Returns the options of a run as it needs them; the file of the report may be wrong only now.

    Args:
        given: The second argument of `run`; None: none were given.

    Returns:
        The options, with the seed as a plain whole number and the report as an absolute path.

    Raises:
        ConfigurationError: An option has an invalid value; the message names it and says what would be right.
    """
    if given is None:
        return RunOptions()
    if not isinstance(given, RunOptions):
        raise ConfigurationError(f"options is {given!r}; RunOptions(seed=7), with the options by name, would be right")
    return replace(given, seed=_seed(given.seed), report=_report(given.report))


def spec_file(given: Any) -> str:
    """Returns the path of a specification as text, after checking the argument's type.

    Raises:
        ConfigurationError: It is no path.
    """
    return _path(given, "spec", "the path of a specification, 'quickstart' or 'nightly'")


def _text(given: Any, option: str, right: str) -> str:
    if not isinstance(given, str):
        raise ConfigurationError(f"{option} is {given!r}; {right} would be right")
    return given


def _path(given: Any, option: str, right: str) -> str:
    try:
        path = os.fspath(given)
    except TypeError:
        path = None
    if not isinstance(path, str) or "\0" in path:
        raise ConfigurationError(f"{option} is {given!r}; {right} would be right")
    return path


def _seed(given: Any) -> int | None:
    if given is None:
        return None
    try:
        seed = operator.index(given)  # NumPy's whole numbers are some, too
    except TypeError:
        seed = None
    if seed is None or isinstance(given, bool):
        raise ConfigurationError(f"seed is {given!r}; a whole number from 0, such as 7, would be right")
    return seed_number(seed, "seed")


def _report(given: Any) -> Path | None:
    return None if given is None else output_file(_path(given, "report", "the path of a file"), "report")


def _check_backend(given: str) -> None:
    try:
        open_backend(given)
    except ConfigurationError as error:  # the caller named an option, not the setting that it replaces
        raise ConfigurationError(str(error).replace("ROBOMAKER_BACKEND", "backend")) from error
