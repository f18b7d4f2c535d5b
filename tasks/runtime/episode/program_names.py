"""Names of a run's programs in messages."""

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.programs import ProgramPlan


def program_in_words(program: ProgramPlan, plan: RunPlan) -> str:
    """Returns `robot application driver`, or `tool watch of simulation application arena`."""
    application = plan.robot_application if program.role == "robot" else plan.simulation_application
    named = f"{program.role} application {application.name}" if application else f"the {program.role} application"
    return f"tool {program.name.removeprefix(f'{program.role}-')} of {named}" if program.kind == "tool" else named
