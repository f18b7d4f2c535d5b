"""The trials that a request for a job orders: by its member, or by a launch variable."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, Protocol

from pydantic import ValidationError

from ..wire.base import Model
from ..wire.errors import InvalidParameterException
from ..wire.job_configs import LaunchConfig, RobotApplicationConfig, SimulationApplicationConfig
from ..wire.json_values import is_list, is_mapping
from ..wire.request_problems import problems_of
from ..wire.strict_json import load_strict
from .trials import TRIALS_VARIABLE, Trials

"""Launch variable that holds the trials as JSON, for SDKs that do not know the member."""

_MAX_CHARACTERS = 1024
_PROGRAMS = (".py", ".launch", ".xml")
"""Endings of launch files that are run as programs; the others name factories."""


class TrialsSource(Protocol):
    """The members of a request that trials can be given in."""

    @property
    def trials(self) -> Trials | None:
        """The extension member."""
        ...

    @property
    def robotApplications(self) -> list[RobotApplicationConfig] | None:  # noqa: N802 - the service's name
        """The robot application, whose launch variables may hold trials."""
        ...

    @property
    def simulationApplications(self) -> list[SimulationApplicationConfig] | None:  # noqa: N802 - the service's name
        """The simulation application, likewise."""
        ...


class _Holder(Model):
    trials: Trials


def trials_of(request: TrialsSource) -> Trials | None:
    """The trials that a request orders; `None`: its job is one episode.

    Raises:
        InvalidParameterException: the variable's text does not describe trials, or they are given twice and differ.
    """
    given = {} if request.trials is None else {"trials": request.trials}
    given |= {place: _parse(text, place) for place, text in _variables(request)}
    if not given:
        return None
    (first, trials), *others = given.items()
    for place, again in others:
        if again != trials:
            raise InvalidParameterException(f"{first} and {place} differ; leave one of them out")
    return trials


def planned_trials(request: Mapping[str, Any]) -> int:
    """How many trials a request on the wire orders, 0 for one episode; quick, as campaigns have many requests.

    Args:
        request: checked or not; what cannot be understood counts as no trials.
    """
    for given in (request.get("trials"), *_texts(request)):
        with suppress(ValidationError, InvalidParameterException):
            if isinstance(given, str):
                return _parse(given, TRIALS_VARIABLE).count
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


def check_trials(request: TrialsSource) -> None:
    """Finds out whether the launch variable says what the member may say, and no application is launched as a program.

    Raises:
        ValueError: it does not, or one is.
    """
    try:
        trials = trials_of(request)
    except InvalidParameterException as error:
        raise ValueError(str(error)) from None
    for place, launch in _launches(request) if trials else ():
        member = "command" if launch.command else "launchFile"
        if launch.command or (launch.launchFile or "").endswith(_PROGRAMS):
            raise ValueError(
                f"trials: {place}.{member} launches a program, which cannot be begun anew for each trial; trials need "
                "applications that are factories (make_environment, make_agent), or a job for each seed"
            )


def _parse(text: str, place: str) -> Trials:
    try:
        return _Holder.model_validate({"trials": load_strict(text, place, _MAX_CHARACTERS)}).trials
    except ValidationError as error:
        lines = [str(problem).removeprefix("trials") for problem in problems_of(error, _Holder)]
        raise InvalidParameterException("\n".join(f"{place}{line}" for line in lines)) from None


def _launches(request: TrialsSource) -> Iterator[tuple[str, LaunchConfig]]:
    """The paths of a request's launch configurations, each with the configuration."""
    for member, configs in (
        ("simulationApplications", request.simulationApplications),
        ("robotApplications", request.robotApplications),
    ):
        for index, config in enumerate(configs or ()):
            yield f"{member}[{index}].launchConfig", config.launchConfig


def _variables(request: TrialsSource) -> Iterator[tuple[str, str]]:
    """The paths of members that set the launch variable, each with the value."""
    for place, launch in _launches(request):
        variables = launch.environmentVariables or {}
        if TRIALS_VARIABLE in variables:
            yield f"{place}.environmentVariables.{TRIALS_VARIABLE}", variables[TRIALS_VARIABLE]
