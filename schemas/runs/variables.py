"""Variables of launch configurations: those that set how a job runs, and those that are secrets."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from ..wire.json_values import is_list, is_mapping
from .plan import ApplicationPlan, RunPlan
from .programs import ProgramPlan
from .trials import TRIALS_VARIABLE, Trials

HIDDEN = "(secret)"
"""Text in place of a secret; with a number where values have to differ, those of a parameter of trials."""

ENDPOINT_VARIABLE = "AWS_ENDPOINT_URL_ROBOMAKER"
"""Environment variable in which SDKs find the address of the service."""

OF_JOB = "/of-job/"
"""Paths of the endpoint that begin so are a job's own: its id and its key follow, and then the path of an operation."""

REFUSED = "/aws"
"""Path of the endpoint below which services of AWS that are not served here are refused."""

CALL_AWS = "ROBOMAKER_JOBS_CALL_AWS"
"""Setting that lets jobs call these services."""

SECRETS_VARIABLE = "ROBOMAKER_SECRETS"
"""A launch variable: the names of other variables that are secrets, with commas between them."""

_NAMES = re.compile(
    r"(^|_)(SECRET|SECRETS|PASSWORD|PASSWD|PASSPHRASE|PWD|TOKEN|CREDENTIALS?|AUTHORIZATION"
    r"|(API|ACCESS|PRIVATE|SECRET|ENCRYPTION|SIGNING)_?KEY)(_|$)",
    re.IGNORECASE,
)
_NO_SECRETS = frozenset({"PWD", "OLDPWD", SECRETS_VARIABLE})
_VARIABLES = "environmentVariables"
_TRIALS, _PARAMETERS = "trials", "parameters"
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


def secret_names(variables: Mapping[str, str], parameters: Iterable[str] = ()) -> set[str]:
    """Returns the names of variables and trial parameters that hold secrets.

    They are recognised by name, or are listed in `ROBOMAKER_SECRETS`.
    """
    marked = {name.strip() for name in variables.get(SECRETS_VARIABLE, "").split(",")}
    names = {*variables, *parameters} - _NO_SECRETS
    return {name for name in names if name in marked or _NAMES.search(name)}


def without_secrets(plan: RunPlan) -> RunPlan:
    """Returns the plan with `(secret)` in place of secret variables, trial parameters, arguments and logins in URLs."""
    applications = [each for each in (plan.robot_application, plan.simulation_application) if each is not None]
    all_variables = [plan.environment, *(each.environment_variables for each in applications)]
    all_variables += [each.environment for each in plan.programs]
    trials = plan.trials
    parameters = (trials.parameters if trials else None) or {}
    names = {name for variables in all_variables for name in secret_names(variables, parameters)}
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
            "trials": trials and trials.model_copy(update=_hidden_parameters(trials, names)),
        }
    )


def hide_secrets(document: Any) -> Any:
    """Returns JSON data, such as a request, with `(secret)` in place of the secrets inside.

    These are among its variables and the parameters of its trials. A variable that is a secret in one launch
    configuration is one in all of them. Without any it is `document` itself.
    """
    parameters = set(_parameters_in(document))
    names = secret_names({}, parameters)
    for variables in _variables_in(document):
        names |= secret_names({name: str(value) for name, value in variables.items()}, parameters)
    return _with_hidden(document, names) if names else document


def _parameters_in(value: Any) -> Iterator[str]:
    """The names of the parameters of all trials."""
    if is_mapping(value):
        for name, inner in value.items():
            if name == _TRIALS and is_mapping(inner):
                yield from inner[_PARAMETERS] if is_mapping(inner.get(_PARAMETERS)) else ()
            else:
                yield from _parameters_in(_read(inner) if name == TRIALS_VARIABLE else inner)
    elif is_list(value):
        for inner in value:
            yield from _parameters_in(inner)


def _read(text: Any) -> Any:
    """The trials that a launch variable's text says, as a request has them; its text if it says something else."""
    try:
        return {_TRIALS: json.loads(text)}
    except (TypeError, ValueError, RecursionError):
        return text


def _variables_in(value: Any) -> Iterator[Mapping[str, Any]]:
    """The variables of all launch configurations."""
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
    if name == _TRIALS and is_mapping(value) and is_mapping(given := value.get(_PARAMETERS)):
        return {
            **value,
            _PARAMETERS: {each: _hidden_values(given[each]) if each in names else given[each] for each in given},
        }
    return _with_hidden(value, names)


def _hidden_variables(variables: Mapping[str, Any], names: set[str]) -> dict[str, Any]:
    hidden = {name: HIDDEN if name in names and text else text for name, text in variables.items()}
    if is_mapping(given := _read(hidden.get(TRIALS_VARIABLE))) and (shown := _with_hidden(given, names)) != given:
        hidden[TRIALS_VARIABLE] = json.dumps(shown[_TRIALS])
    return hidden


def _hidden_parameters(trials: Trials, names: set[str]) -> dict[str, Any]:
    return _hidden_member(_TRIALS, {_PARAMETERS: trials.parameters}, names)


def _hidden_values(values: Any) -> Any:
    """Replaces a parameter's values by different placeholders, so that the result can be parsed again."""
    count = len(values) if is_list(values) else 1
    hidden = [HIDDEN, *(f"{HIDDEN[:-1]} {number})" for number in range(2, count + 1))]
    return hidden if is_list(values) else HIDDEN
