"""A job worker of one simulation job in a process of its own, which can be killed."""

import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import pytest

from helpers.processes import started, wait_for
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

_PERFORM = """
import os, sys
from dataclasses import replace
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.service.service import Timing

service = Service.open(Settings.from_environment(os.environ))
perform_job(sys.argv[1], replace(service, timing=Timing(lease_s=6.0, renew_lease_every_s=0.3)))
"""

PerformElsewhere = Callable[[str], AbstractContextManager["subprocess.Popen[str]"]]
AwaitStatus = Callable[..., dict[str, Any]]


@pytest.fixture
def perform_elsewhere(service: Service) -> PerformElsewhere:
    """Starts a process that performs the job of an ARN; it is killed at the end of the `with` block."""

    def start(arn: str) -> AbstractContextManager["subprocess.Popen[str]"]:
        command = [sys.executable, "-c", _PERFORM, arn]
        return started(command, {"ROBOMAKER_HOME": str(service.settings.home)}, stderr=subprocess.PIPE)

    return start


@pytest.fixture
def await_status(service: Service) -> AwaitStatus:
    """Waits until a job has one of some statuses; returns its description."""

    def wait(arn: str, *statuses: str) -> dict[str, Any]:
        def look() -> dict[str, Any] | None:
            job = call("DescribeSimulationJob", {"job": arn}, service)
            return job if job["status"] in statuses else None

        found = wait_for(look, f"{arn} to be {' or '.join(statuses)}")
        assert found is not None
        return found

    return wait
