"""Jobs that are programs."""

from collections.abc import Callable
from typing import Any

import pytest
from helpers.small_flat import ROLE

from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]


@pytest.fixture
def order_command(sleeper: dict[str, Any], service: Service) -> Order:
    """Makes the request of a job whose simulation application is a bash script, and the only one."""
    del sleeper  # its bundle is what the applications have
    service.store.ensure_bucket("results")

    def make(script: str, application: str = "sleeper", **members: Any) -> dict[str, Any]:
        config = {
            "application": application,
            # Words of a command have at most 255 characters, variables 1024.
            "launchConfig": {
                "command": ["bash", "-c", 'eval "$SCRIPT"'],
                "environmentVariables": {"SCRIPT": script, **members.pop("variables", {})},
                **members.pop("launch", {}),
            },
            **members.pop("config", {}),
        }
        return {
            "maxJobDurationInSeconds": 60,
            "iamRole": ROLE,
            "outputLocation": {"s3Bucket": "results"},
            "simulationApplications": [config],
            **members,
        }

    return make
