"""Reads files that the user names: specifications, and requests of operations."""

import argparse
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ....schemas.operations.registry import OPERATIONS
from ....schemas.settings import Settings
from ....schemas.specs.parameters import AsText
from ....schemas.specs.specification import CheckedSpec
from ....schemas.specs.yaml_nodes import MappingNode, parse, plain
from ....schemas.wire.errors import ConfigurationError, Place, Problem, RobomakerError, SpecError
from ...spec_runs.visitor_specifications import SHIPPED, checked, checked_as_far_as_possible
from .named_code import check_code

_WORLD_ARN = ":world/"
"""Part of every world's ARN, and of no other."""


class InputFileError(ConfigurationError):
    """Raised for a file named by the user that cannot be read."""


def read_text(path: str) -> str:
    """Reads a text file that the user named.

    Raises:
        InputFileError: The file cannot be opened.
        SpecError: The file is not UTF-8 text.
    """
    try:
        return Path(path).read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputFileError(f"{path}: {(error.strerror or str(error)).lower()}") from error
    except UnicodeDecodeError as error:
        problem = Problem(Place(path, 1, 1), "", f"this is not UTF-8 text: {error.reason} at byte {error.start}")
        raise SpecError([problem]) from error


def given_parameters(arguments: argparse.Namespace) -> dict[str, Any]:
    """Returns the values that a command line gives a specification's parameters, by `--set` and `--parameters`.

    Args:
        arguments: Parsed arguments of the command.

    Returns:
        Values by name, as `load_spec` takes them; those of a file know their place there.

    Raises:
        InputFileError: The file cannot be opened.
        SpecError: The file is no mapping of names.
        ConfigurationError: A word of `--set` has no `=`, or a name is there twice.
    """
    given: dict[str, Any] = {}
    if arguments.parameters is not None:
        root = parse(read_text(arguments.parameters), arguments.parameters)
        if not isinstance(root, MappingNode):
            raise SpecError([Problem(root.place, "", "values of parameters are a mapping, such as worlds: 20")])
        given |= root.entries
    named: set[str] = set()
    for word in arguments.set:
        name, is_given, text = word.partition("=")
        if not is_given or not name:
            raise ConfigurationError(f"--set is {word!r}; NAME=VALUE, such as worlds=20, would be right")
        if name in named:
            raise ConfigurationError(f"--set gives {name!r} two values; leave one out")
        named.add(name)
        given[name] = AsText(text)
    return given


def read_spec(
    path: str,
    parameters: Mapping[str, Any] | None = None,
    *,
    is_complete: bool = True,
    with_code: bool = False,
    with_worlds: bool = True,
) -> CheckedSpec:
    """Reads and checks a specification file; worlds that it names are found in the catalog.

    Args:
        path: A file; or `quickstart` or `nightly`, if there is no such file: they come with this package.
        parameters: Values of its parameters; see `given_parameters`.
        is_complete: Whether each parameter has to have a value, as for a run.
        with_code: Whether to look at the code that the specification points at, too.
        with_worlds: Whether to find the worlds that it names in the catalog.

    Raises:
        InputFileError: The file cannot be opened.
        SpecError: The specification is invalid; the error lists all its problems.
    """
    shipped = SHIPPED / f"{path}.yaml"
    is_shipped = "." not in path and "/" not in path and not Path(path).exists() and shipped.is_file()
    try:
        text = read_text(str(shipped) if is_shipped else path)
    except InputFileError as error:
        raise InputFileError(f"{error}{_meant_instead(path)}") from error
    if not with_code:
        spec = checked(text, path, parameters, is_complete=is_complete)
        return _with_worlds_found(spec) if with_worlds else spec
    spec, problems = checked_as_far_as_possible(text, path, parameters, is_complete=is_complete)
    code = check_code(spec, Settings.from_environment(os.environ), told={each.path for each in problems})
    spec, problems = replace(spec, notes=(*spec.notes, *code.notes)), [*problems, *code.problems]
    try:
        spec = _with_worlds_found(spec)
        _check_rooms(spec)
    except SpecError as error:
        problems += error.problems
    except (RobomakerError, OSError):  # the catalog, say, does not answer; problems of the file are told all the same
        if not problems:
            raise
    if problems:
        raise SpecError(sorted(problems, key=lambda each: (each.place.line, each.place.column)), spec.notes)
    return spec


def _meant_instead(path: str) -> str:
    """Returns words about a run whose specification has about the name that was given for a file; empty: none has."""
    from ....schemas.reports.names import specification_of

    if "." in path or "/" in path:
        return ""
    runs = Settings.from_environment(os.environ).home / "runs"
    names = {specification_of(each.parent.name) for each in runs.glob("*/order.json")}
    names |= {specification_of(each.parent.name) for each in runs.glob("*/run.json")}
    if not (near := get_close_matches(path, sorted(names), n=1)):
        return "; a specification is a file, and runs are listed by `robomaker history`"
    again = f"`robomaker rerun {near[0]}` runs it again, `robomaker report {near[0]}` tells how it went"
    return f"; a specification is a file; there are runs of {near[0]}: {again}"


def _tell_world(name: str, arn: str) -> None:
    sys.stderr.write(f"{name!r} is {arn}\n")


def _with_worlds_found(spec: CheckedSpec, tell: Callable[[str, str], None] = lambda _name, _arn: None) -> CheckedSpec:
    """Puts ARNs in place of the names of worlds; opens the catalog only if there is any, since that takes a while."""
    if not any(step.worlds for step in spec.steps.values()):
        return spec
    from ....tasks.service.world_names import with_worlds_found
    from .options import open_service

    return with_worlds_found(spec, open_service(), tell)


def _check_rooms(spec: CheckedSpec) -> None:
    """Checks rooms of existing worlds as a run does before its first step; opens the catalog only if one is named."""
    if not any(_WORLD_ARN in str(plain(step.input)) for step in spec.steps.values()):
        return
    from ....tasks.inspection.preflight import check_rooms
    from .options import open_service

    try:
        service = open_service()
    except RobomakerError:
        return  # what is away now says so when it runs; the rest of the file can be checked all the same
    check_rooms(spec, service)


def read_request(given: str, operation: str) -> dict[str, Any]:
    """Reads the members of an API request from a file, JSON or YAML text, or standard input.

    Worlds may be named as people do; the ARNs that the names mean are printed on standard error.

    Args:
        given: A file's path or `file://` address, JSON or YAML text that begins with `{`, or `-` for standard input.
        operation: The operation's name.

    Raises:
        ServiceError: The text is not a valid request of this operation.
    """
    from ....schemas.specs.check import load_request
    from ....schemas.specs.resolving import resolve_input

    text, name = _text(given)
    try:
        checked = _with_worlds_found(load_request(text, name, operation), _tell_world)
    except SpecError as error:
        error.page = "docs/operations.md has each operation with an example"
        raise
    return resolve_input(checked.steps[checked.order[0]], {})


def _text(given: str) -> tuple[str, str]:
    """Returns the text of an operation's request, and its name for error messages.

    It is read from standard input (`-`) or a file, unless it is JSON itself. An error is raised if the file cannot be
    read.
    """
    if given == "-":
        return sys.stdin.read(), "standard input"
    if given.lstrip().startswith("{"):
        return given, "--input"
    path = given.removeprefix("file://")
    return read_text(path), path


def operation_name(word: str) -> str:
    """Converts an operation's name from the AWS CLI's spelling (`describe-world`) to the service's.

    A word that names no operation is returned unchanged; the check of the request suggests a similar name.
    """
    folded = word.replace("-", "").lower()
    return next((name for name in OPERATIONS if name.lower() == folded), word)
