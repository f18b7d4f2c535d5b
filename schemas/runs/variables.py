"""Variables of launch configurations that set how a job runs."""

import math
from collections.abc import Mapping

from .plan import RunPlan


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
