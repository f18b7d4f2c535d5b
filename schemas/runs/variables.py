"""Variables of launch configurations: those that configure how a job runs, and those that are secrets."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from ..wire.json_values import is_list, is_mapping
from .plan import ApplicationPlan, RunPlan
from .programs import ProgramPlan
from .trials import TRIALS_VARIABLE, Trials

TIME_LIMIT_VARIABLE = "ROBOMAKER_SIM_TIME_LIMIT_S"
"""Name of the launch variable with the simulated seconds after which `indoor-navigation` ends a run."""

HIDDEN = "(secret)"
"""Text that replaces a secret; followed by a number if different values have to stay distinguishable."""

ENDPOINT_VARIABLE = "AWS_ENDPOINT_URL_ROBOMAKER"
"""Name of the environment variable in which SDKs find the URL of the service."""

OF_JOB = "/of-job/"
"""Prefix of endpoint paths for calls of a job: its id and its key follow, then the path of an operation."""

REFUSED = "/aws"
"""Prefix of endpoint paths at which calls to AWS services that are not provided here are refused."""

CALL_AWS = "ROBOMAKER_JOBS_CALL_AWS"
"""Name of the setting that lets jobs call AWS services."""

SECRETS_VARIABLE = "ROBOMAKER_SECRETS"
"""Name of the launch variable with the comma-separated names of other variables that are secrets."""

_NAMES = re.compile(
    r"(^|_)(SECRET|SECRETS|PASSWORD|PASSWD|PASSPHRASE|PWD|TOKEN|CREDENTIALS?|AUTHORIZATION"
    r"|(API|ACCESS|PRIVATE|SECRET|ENCRYPTION|SIGNING)_?KEY)(_|$)",
    re.IGNORECASE,
)
_NO_SECRETS = frozenset({"PWD", "OLDPWD", SECRETS_VARIABLE})
_VARIABLES = "environmentVariables"
_TRIALS, _AXES = "trials", "axes"
_CELLS = ("include", "exclude")
"""Members of trials that contain axis values by name."""
_LOGIN_IN_URL = re.compile(r"(?<=://)[^/\s:@]*:[^/\s@]+(?=@)")


def variables_of(plan: RunPlan) -> Mapping[str, str]:
    """Returns the environment variables of a simulation run; the simulation application's values win."""
    variables = dict(plan.environment)
    for application in (plan.robot_application, plan.simulation_application):
        variables |= application.environment_variables if application else {}
    return variables


def number_in(text: str) -> float:
    """Parses the number in a launch variable; returns NaN, which fails every bound, for any other text."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def secret_names(variables: Mapping[str, str], axes: Iterable[str] = ()) -> set[str]:
    """Returns the names of variables, and of axes of trials that are variables, that hold secrets.

    They are recognised by name, or are listed in `ROBOMAKER_SECRETS`.
    """
    marked = {name.strip() for name in variables.get(SECRETS_VARIABLE, "").split(",")}
    names = {*variables, *axes} - _NO_SECRETS
    return {name for name in names if name in marked or _NAMES.search(name)}


def without_secrets(plan: RunPlan) -> RunPlan:
    """Returns the plan of a run with `(secret)` in place of secret variables, axes, arguments and logins in URLs."""
    applications = [each for each in (plan.robot_application, plan.simulation_application) if each is not None]
    all_variables = [plan.environment, *(each.environment_variables for each in applications)]
    all_variables += [each.environment for each in plan.programs]
    trials = plan.trials
    axes = set(_axes_in({_TRIALS: trials.to_wire()})) if trials else set[str]()
    names = {name for variables in all_variables for name in secret_names(variables, axes)}
    values = {variables[name] for variables in all_variables for name in names if variables.get(name)}

    def cleaned(text: str) -> str:
        for value in sorted(values, key=len, reverse=True):
            text = HIDDEN if text == value else text.replace(f"={value}", f"={HIDDEN}")
        return _LOGIN_IN_URL.sub(HIDDEN, text)

    def variables(given: Mapping[str, str]) -> dict[str, str]:
        return {name: cleaned(value) for name, value in _hidden_variables(given, names).items()}

    def application(given: ApplicationPlan | None) -> ApplicationPlan | None:
        return given and given.model_copy(update={"environment_variables": variables(given.environment_variables)})

    def program(given: ProgramPlan) -> ProgramPlan:
        changes = {"environment": variables(given.environment), "argv": [cleaned(word) for word in given.argv]}
        return given.model_copy(update=changes)

    return plan.model_copy(
        update={
            "environment": variables(plan.environment),
            "robot_application": application(plan.robot_application),
            "simulation_application": application(plan.simulation_application),
            "programs": [program(each) for each in plan.programs],
            "trials": trials and Trials.model_validate(_hidden_member(_TRIALS, trials.to_wire(), names)),
        }
    )


def hide_secrets(document: Any) -> Any:
    """Returns JSON data, such as a request, with `(secret)` in place of the secrets inside.

    Secrets are values of launch variables and axes of trials. A variable that is secret in one launch configuration is
    secret in all of them. Without secrets the result is `document` itself.
    """
    axes = set(_axes_in(document))
    names = secret_names({}, axes)
    for variables in _variables_in(document):
        names |= secret_names({name: str(value) for name, value in variables.items()}, axes)
    return _with_hidden(document, names) if names else document


def _axes_in(value: Any) -> Iterator[str]:
    """Yields the names of the axes of all trials that are environment variables."""
    if is_mapping(value):
        for name, inner in value.items():
            if name == _TRIALS and is_mapping(inner):
                axes = inner.get(_AXES)
                for each, axis in axes.items() if is_mapping(axes) else ():
                    if is_mapping(axis) and axis.get("kind") == "variable":
                        yield each
            else:
                yield from _axes_in(_read(inner) if name == TRIALS_VARIABLE else inner)
    elif is_list(value):
        for inner in value:
            yield from _axes_in(inner)


def _read(text: Any) -> Any:
    """Parses the trials in a launch variable's text; returns the text if it is no such JSON."""
    try:
        return {_TRIALS: json.loads(text)}
    except (TypeError, ValueError, RecursionError):
        return text


def _variables_in(value: Any) -> Iterator[Mapping[str, Any]]:
    """Yields the variables of all launch configurations."""
    if is_mapping(value):
        for name, inner in value.items():
            if name == _VARIABLES and is_mapping(inner):
                yield inner
            else:
                yield from _variables_in(inner)
    elif is_list(value):
        for inner in value:
            yield from _variables_in(inner)


def _with_hidden(value: Any, names: set[str]) -> Any:
    if is_list(value):
        return [_with_hidden(inner, names) for inner in value]
    if not is_mapping(value):
        return value
    return {name: _hidden_member(name, inner, names) for name, inner in value.items()}


def _hidden_member(name: str, value: Any, names: set[str]) -> Any:
    if name == _VARIABLES and is_mapping(value):
        return _hidden_variables(value, names)
    if name == _TRIALS and is_mapping(value) and is_mapping(value.get(_AXES)):
        return _hidden_trials(value, names)
    return _with_hidden(value, names)


def _hidden_variables(variables: Mapping[str, Any], names: set[str]) -> dict[str, Any]:
    hidden = {name: HIDDEN if name in names and text else text for name, text in variables.items()}
    if is_mapping(given := _read(hidden.get(TRIALS_VARIABLE))) and (shown := _with_hidden(given, names)) != given:
        hidden[TRIALS_VARIABLE] = json.dumps(shown[_TRIALS])
    return hidden


def _hidden_trials(trials: Mapping[str, Any], names: set[str]) -> dict[str, Any]:
    """Returns trials with the values of secret axes replaced; different values get different replacements."""
    cells = [cell for member in _CELLS if is_list(found := trials.get(member)) for cell in found if is_mapping(cell)]
    axes: Mapping[str, Any] = trials[_AXES] if is_mapping(trials.get(_AXES)) else {}
    hidden: dict[str, dict[str, str]] = {}
    for name in names & set(axes):
        listed = axes[name].get("values") if is_mapping(axes[name]) else None
        values = [*(listed if is_list(listed) else ()), *(cell[name] for cell in cells if name in cell)]
        hidden[name] = {text: _numbered(number) for number, text in enumerate(dict.fromkeys(map(str, values)), start=1)}

    def shown(name: str, value: Any) -> Any:
        return hidden[name].get(str(value), HIDDEN) if name in hidden else value

    def axis(name: str, given: Any) -> Any:
        if name not in hidden or not is_mapping(given):
            return HIDDEN if name in hidden else given
        values = given.get("values")
        return {**given, "values": [shown(name, each) for each in values] if is_list(values) else HIDDEN}

    def cell(given: Any) -> Any:
        return {name: shown(name, value) for name, value in given.items()} if is_mapping(given) else given

    lists = {member: list(map(cell, found)) for member in _CELLS if is_list(found := trials.get(member))}
    return {**trials, _AXES: {name: axis(name, given) for name, given in axes.items()}, **lists}


def _numbered(number: int) -> str:
    return HIDDEN if number == 1 else f"{HIDDEN[:-1]} {number})"
