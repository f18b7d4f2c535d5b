"""Checks a backend by running one small job there, as part of a batch."""

import sys
import time
from dataclasses import replace
from typing import Any

from ...schemas.settings import Settings
from ...schemas.wire.errors import RobomakerError
from .doctor_checks import Finding

_PLACE = "python://prefect_robomaker.tasks.runtime.applications.falling_ball"
_ROLE = "arn:aws:iam::000000000000:role/doctor"
_TIMEOUT_S = 300
_REMEDY = "docs/machines.md says what each machine needs"


def check_backend(settings: Settings) -> Finding:
    """Runs a test job on the configured backend (where jobs run), and reports the result.

    Args:
        settings: Settings of a run, with the backend that is examined.
    """
    from ...tasks.jobs.job_owners import OwnOrder
    from ...tasks.operations.registry import call, registry
    from ...tasks.service.service import Service
    from .prefect_server import use_server

    subject = f"backend {settings.backend}"
    try:
        service = replace(Service.open(settings), report_note=_tell)
        use_server(settings, for_runs=True)
        from ...flows import lookup  # it imports Prefect, which reads its server's address then

        with OwnOrder(service) as own:
            batch = registry()["StartSimulationJobBatch"].ordered(_request(service), own.through, service)["arn"]
            own.keep(batch)
            began = time.monotonic()
            with service.activated():
                answer, _ = lookup.perform("StartSimulationJobBatch", batch)
    except RobomakerError as error:
        return Finding(subject, "broken", str(error), _REMEDY)
    took_s = time.monotonic() - began
    jobs = [call("DescribeSimulationJob", {"job": job["arn"]}, service) for job in answer["createdRequests"]]
    if [job["status"] for job in jobs] == ["Completed"]:
        return Finding(subject, "ok", f"one job ran there; it took {took_s:.0f} s with the start of its job worker")
    reasons = [job.get("failureReason") for job in jobs] + [answer.get("failureReason")]
    found = "\n".join(reason for reason in reasons if reason) or f"the batch is {answer['status']}"
    return Finding(subject, "broken", found, _REMEDY)


def _tell(note: str) -> None:
    """Prints a note about the progress of a backend's check."""
    sys.stderr.write(f"{note}\n")
    sys.stderr.flush()


def _request(service: Any) -> dict[str, Any]:
    """Makes the request for a batch of one small job; creates its robot and simulation applications if missing."""
    from ...tasks.operations.existing_resources import reuse_application
    from ...tasks.operations.registry import call

    common = {"name": "robomaker-doctor", "environment": {"uri": _PLACE}, "robotSoftwareSuite": {"name": "General"}}
    simulation = {**common, "simulationSoftwareSuite": {"name": "SimulationRuntime"}}
    if reuse_application("robot", common, service) is None:
        call("CreateRobotApplication", common, service)
    if reuse_application("simulation", simulation, service) is None:
        call("CreateSimulationApplication", simulation, service)
    job = {
        "maxJobDurationInSeconds": 60,
        "iamRole": _ROLE,
        "robotApplications": [{"application": common["name"], "launchConfig": {}}],
        "simulationApplications": [{"application": common["name"], "launchConfig": {}}],
    }
    return {
        "createSimulationJobRequests": [job],
        "batchPolicy": {"maxConcurrency": 1, "timeoutInSeconds": _TIMEOUT_S},
    }
