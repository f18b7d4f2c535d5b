"""One served process tree for all clients of a test run's worker, and what they ask it for."""

import itertools
import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from helpers.client_environments import python_environment
from helpers.endpoint_process import Served, serving
from helpers.paths import BUNDLES
from helpers.small_flat import BODY, ROLE

from prefect_robomaker.tasks.storage import pack_tar_gz

_numbers = itertools.count(1)


@dataclass(frozen=True)
class Place:
    """A running `robomaker serve`, and the folder that is its object store."""

    served: Served
    objects: Path

    @property
    def environ(self) -> dict[str, str]:
        """What it tells clients to set."""
        return dict(self.served.facts["environment"])


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory, prefect_server: str) -> Iterator[Place]:
    """The served process tree, with an application to run in its object store."""
    folder = tmp_path_factory.mktemp("clients")
    objects = folder / "home" / "objects"
    bundle = folder / "bundle"
    shutil.copytree(BUNDLES / "sleeper", bundle, ignore=shutil.ignore_patterns("__pycache__"))
    for bucket in ("applications", "results"):
        (objects / bucket).mkdir(parents=True)
    pack_tar_gz(bundle, objects / "applications" / "sleeper.tar.gz")
    with serving(folder / "home", folder, "--max-jobs", "4", PREFECT_API_URL=prefect_server) as served:
        served.wait_until_ready()
        yield Place(served, objects)
        served.process.terminate()
        assert served.process.wait(30) == 0, served.log.read_text()
    assert "Traceback" not in served.log.read_text()


@pytest.fixture
def wanted(worker_id: str) -> dict[str, Any]:
    """What a client asks for, under a name that nobody else uses."""
    return {
        "name": f"{worker_id}-{next(_numbers)}",
        "role": ROLE,
        "bucket": "results",
        "body": json.dumps(BODY),
        "sources": [{"s3Bucket": "applications", "s3Key": "sleeper.tar.gz", "architecture": "X86_64"}],
        "package": "sleeper",
    }


@pytest.fixture(scope="session")
def old_programs(pytestconfig: pytest.Config) -> Path:
    """Programs of the environment with the last boto3 and AWS CLI that have the service."""
    return python_environment(pytestconfig)
