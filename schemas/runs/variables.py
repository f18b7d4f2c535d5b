"""Variables of launch configurations: those that set how a job runs, and those that are secrets."""

import math
import re
from collections.abc import Mapping

from .plan import ApplicationPlan, RunPlan
from .programs import ProgramPlan

HIDDEN = "(secret)"
"""What is written in place of a secret."""

SECRETS_VARIABLE = "ROBOMAKER_SECRETS"
"""A launch variable: the names of other variables that are secrets, with commas between them."""

_NAMES = re.compile(
    r"(^|_)(SECRET|SECRETS|PASSWORD|PASSWD|PASSPHRASE|PWD|TOKEN|CREDENTIALS?|AUTHORIZATION"
    r"|(API|ACCESS|PRIVATE|SECRET|ENCRYPTION|SIGNING)_?KEY)(_|$)",
    re.IGNORECASE,
)
_NO_SECRETS = frozenset({"PWD", "OLDPWD", SECRETS_VARIABLE})
_LOGIN_IN_URL = re.compile(r"(?<=://)[^/\s:@]*:[^/\s@]+(?=@)")


def variables_of(plan: RunPlan) -> Mapping[str, str]:
    """The variables of a run; what the simulation application's configuration says goes first."""
    variables = dict(plan.environment)
    for application in (plan.robot_application, plan.simulation_application):
        variables |= application.environment_variables if application else {}
    return variables


def number_in(text: str) -> float:
    """The number that a variable says; not a number, which no bound admits, when it says something else."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def secret_names(variables: Mapping[str, str]) -> set[str]:
    """The variables that are secrets: by their names, or since `ROBOMAKER_SECRETS` says so."""
    marked = {name.strip() for name in variables.get(SECRETS_VARIABLE, "").split(",")}
    return {name for name in variables if name not in _NO_SECRETS and (name in marked or _NAMES.search(name))}


def without_secrets(plan: RunPlan) -> RunPlan:
    """The plan with `(secret)` in place of secrets, in variables and on command lines, and of logins in URLs."""
    applications = [each for each in (plan.robot_application, plan.simulation_application) if each is not None]
    all_variables = [plan.environment, *(each.environment_variables for each in applications)]
    all_variables += [each.environment for each in plan.programs]
    names = {name for variables in all_variables for name in secret_names(variables)}
    values = {variables[name] for variables in all_variables for name in names if variables.get(name)}

    def cleaned(text: str) -> str:
        for value in sorted(values, key=len, reverse=True):
            text = HIDDEN if text == value else text.replace(f"={value}", f"={HIDDEN}")
        return _LOGIN_IN_URL.sub(HIDDEN, text)

    def variables(given: Mapping[str, str]) -> dict[str, str]:
        return {name: HIDDEN if name in names and value else cleaned(value) for name, value in given.items()}

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
        }
    )
