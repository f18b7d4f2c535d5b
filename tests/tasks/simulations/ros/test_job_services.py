"""What programs of a job get answered over its socket; real nodes ask in `tests/journeys/test_ros_jobs.py`."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.small_flat import ROLE

from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.ros import job_services
from prefect_robomaker.tasks.simulations.ros.job_services import FOLDER, NODE, answering
from prefect_robomaker.tasks.simulations.ros.service_node import SOCKET, ask


@pytest.fixture
def job(service: Service) -> str:
    request = {
        "maxJobDurationInSeconds": 60, "iamRole": ROLE,
        "simulationApplications": [{"application": "indoor-navigation", "launchConfig": {}}],
    }  # fmt: skip
    return call("CreateSimulationJob", request, service)["arn"]


@pytest.fixture
def folder(service: Service, job: str, tmp_path: Path) -> Iterator[Path]:
    """The folder of a socket that is answered; its path is longer than a socket's may be."""
    root = tmp_path / ("long" * 30)
    (root / FOLDER).mkdir(parents=True)
    with answering(root, job, service):
        yield root / FOLDER
    assert ask(str(root / FOLDER), {"operation": "list_tags"})["success"] is False


def told(folder: Path, sent: bytes) -> dict[str, Any]:
    """What the worker says to bytes."""
    place = os.open(folder, os.O_PATH)
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(f"/proc/self/fd/{place}/{SOCKET}")
        os.close(place)
        connection.sendall(sent)
        connection.shutdown(socket.SHUT_WR)
        return json.loads(connection.makefile("rb").readline())


def test_a_job_tags_and_cancels_itself(folder: Path, job: str, service: Service) -> None:
    added = ask(str(folder), {"operation": "add_tags", "tags": {"a": "1", "b": "2"}})
    removed = ask(str(folder), {"operation": "remove_tags", "keys": ["b"]})

    assert added["success"]
    assert removed["success"]
    assert ask(str(folder), {"operation": "list_tags"}) == {"success": True, "message": "", "tags": {"a": "1"}}
    assert call("ListTagsForResource", {"resourceArn": job}, service)["tags"] == {"a": "1"}
    assert not service.catalog.cancel_requested(job)
    assert ask(str(folder), {"operation": "cancel"})["success"]
    assert service.catalog.cancel_requested(job)


@pytest.mark.parametrize(
    ("sent", "message"),
    [
        (b"", "one line of JSON"),
        (b"\xff\n", "one line of JSON"),
        (b"[" * 60_000 + b"\n", "RecursionError"),
        (b'"' + b"x" * (1 << 17), "at most 65536 bytes"),
        (b"[]\n", "operation: None has to be cancel"),
        (b'{"operation": "delete"}\n', "'delete' has to be cancel"),
        (b'{"operation": {"a": 1}}\n', "has to be cancel"),
        (b'{"operation": "add_tags"}\n', "TagResource: tags"),
        (b'{"operation": "add_tags", "tags": {"aws:x": "1"}}\n', "aws:x"),
        (b'{"operation": "remove_tags", "keys": "all"}\n', "UntagResource: tagKeys"),
    ],
)
def test_wrong_questions_are_told_so_and_the_next_is_answered(folder: Path, sent: bytes, message: str) -> None:
    answer = told(folder, sent)

    assert answer["success"] is False
    assert message in answer["message"]
    assert ask(str(folder), {"operation": "list_tags"})["success"]


def test_one_that_says_nothing_holds_the_others_up_for_a_moment_only(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job_services, "_PATIENCE_S", 0.1)
    place = os.open(folder, os.O_PATH)
    with socket.socket(socket.AF_UNIX) as silent:
        silent.connect(f"/proc/self/fd/{place}/{SOCKET}")
        os.close(place)
        assert ask(str(folder), {"operation": "list_tags"})["success"]


def test_other_users_are_not_answered(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 4711)
    assert "own user" in ask(str(folder), {"operation": "cancel"})["message"]


def test_runs_without_ros_listen_to_nothing(service: Service, tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    with answering(root, "arn", service), answering(None, "arn", service):
        assert list(root.iterdir()) == []


RCLPY = """
from types import SimpleNamespace

offered = {}

def init(): ...

def create_node(name):
    return SimpleNamespace(create_service=lambda kind, name, answer: offered.update({name: (kind, answer)}))

def spin(node):
    add, remove, tags, cancel = (offered[f"/robomaker/job/{name}"] for name in NAMES)
    said = [
        add[1](add[0].Request(tags=[SimpleNamespace(key="a", value="1"), SimpleNamespace(key="b", value="2")]), kind()),
        remove[1](remove[0].Request(keys=["b"]), kind()),
        tags[1](tags[0].Request(), kind()),
        cancel[1](cancel[0].Request(), kind()),
    ]
    print([(response.success, response.message) for response in said], said[2].tags[0].key, said[2].tags[0].value)

NAMES = ("add_tags", "remove_tags", "list_tags", "cancel")
kind = SimpleNamespace
"""
"""As much of rclpy as the node calls, with one client; ROS 2 itself has no package in Debian."""


def test_a_node_of_ros_2_offers_the_services(folder: Path, job: str, service: Service, tmp_path: Path) -> None:
    modules = tmp_path / "modules"
    messages = modules / "robomaker_simulation_msgs"
    messages.mkdir(parents=True)
    (modules / "rclpy.py").write_text(RCLPY)
    kinds = "from types import SimpleNamespace as N\n" + "".join(
        f"{name} = N(Request=N)\n" for name in ("Cancel", "AddTags", "RemoveTags", "ListTags")
    )
    (messages / "srv.py").write_text(kinds)
    (messages / "msg.py").write_text("from types import SimpleNamespace as Tag\n")

    def run(task: str) -> subprocess.CompletedProcess[str]:
        argv = [sys.executable, str(NODE), task, "2", str(folder)]
        return subprocess.run(argv, env={"PYTHONPATH": str(modules)}, capture_output=True, text=True, check=False)

    assert run("make").returncode == 0
    assert run("serve").stdout == "[(True, ''), (True, ''), (True, ''), (True, '')] a 1\n"
    assert call("ListTagsForResource", {"resourceArn": job}, service)["tags"] == {"a": "1"}
    assert service.catalog.cancel_requested(job)
    (messages / "srv.py").unlink()
    assert run("make").returncode, "a workspace without the messages"
