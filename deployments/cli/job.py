"""Carrying a stored job to its end, in this process: for `perform`, and for `call --wait`."""

from ...schemas.settings import Settings
from .output.answers import print_answer

_BAD_ENDS = {"Failed": 3, "Canceled": 4, "TimedOut": 5}


def perform(operation: str, arn: str, settings: Settings, form: str) -> int:
    """Carries the job that an operation made to its end and prints its final description.

    Returns:
        0 all well, 1 a simulation's verdict is fail, 3 something broke, 4 cancelled, 5 timed out.
    """
    from .prefect_server import use_server

    use_server(settings)
    from ...flows.lookup import find_perform_flow
    from ...tasks.inspection.reports import simulation_jobs
    from ...tasks.service.service import Service

    service = Service.open(settings)
    with service.activated():
        answer = find_perform_flow(operation)(arn)
    print_answer(answer, form)
    if bad := _BAD_ENDS.get(str(answer.get("status"))):
        return bad
    jobs = simulation_jobs(operation, arn, service)
    verdicts = [job.result.verdict for job in jobs if job.result]
    if any(job.status in ("Failed", "NotCreated") for job in jobs) or "ERROR" in verdicts:
        return 3
    return 1 if "FAIL" in verdicts else 0
