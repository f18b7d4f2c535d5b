"""The trials that a request for a job orders: by its member, or by a launch variable."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from pydantic import ValidationError

from ..wire.base import Model
from ..wire.errors import InvalidParameterException
from ..wire.job_configs import MAX_VARIABLE_CHARACTERS, JobRequest, given_once, is_program, launches
from ..wire.json_values import is_list, is_mapping
from ..wire.request_problems import parsed_member
from ..wire.strict_json import load_strict
from .trials import TRIALS_VARIABLE, Trials


class _Holder(Model):
    trials: Trials


def trials_of(request: JobRequest) -> Trials | None:
    """The trials that a request orders; `None`: its job is one episode.

    Raises:
        InvalidParameterException: the variable's text does not describe trials, or they are given twice and differ.
    """
    return given_once(request, "trials", TRIALS_VARIABLE, _parse)[1]


def planned_trials(request: Mapping[str, Any]) -> int:
    """How many trials a request on the wire orders, 0 for one episode; quick, as campaigns have many requests.

    Args:
        request: checked or not; what cannot be understood counts as no trials.
    """
    for given in (request.get("trials"), *_texts(request)):
        with suppress(ValidationError, InvalidParameterException):
            if isinstance(given, str):
                return _parse(load_strict(given, TRIALS_VARIABLE, MAX_VARIABLE_CHARACTERS), TRIALS_VARIABLE).count
            if given is not None:
                return Trials.model_validate(given).count
    return 0


def _texts(request: Mapping[str, Any]) -> Iterator[str]:
    """The values of the launch variable in a request that may be anything."""
    for member in ("simulationApplications", "robotApplications"):
        configs = request.get(member)
        for config in configs if is_list(configs) else []:
            launch = config.get("launchConfig") if is_mapping(config) else None
            variables = launch.get("environmentVariables") if is_mapping(launch) else None
            text = variables.get(TRIALS_VARIABLE) if is_mapping(variables) else None
            if isinstance(text, str):
                yield text


def check_trials(request: JobRequest) -> None:
    """Finds out whether the launch variable says what the member may say, and no application is launched as a program.

    Raises:
        ValueError: it does not, or one is.
    """
    try:
        trials = trials_of(request)
    except InvalidParameterException as error:
        raise ValueError(str(error)) from None
    for place, launch in launches(request) if trials else ():
        member = "command" if launch.command else "launchFile"
        if is_program(launch):
            raise ValueError(
                f"trials: {place}.{member} launches a program, which cannot be begun anew for each trial; trials need "
                "applications that are factories (make_environment, make_agent), or a job for each seed"
            )


def _parse(data: object, place: str) -> Trials:
    return parsed_member(data, place, "trials", _Holder)
