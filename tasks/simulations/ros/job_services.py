"""ROS services of a job: its programs ask about the job, and cancel it, over a socket."""

import json
import logging
import os
import socket
import struct
import subprocess
import threading
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ....schemas.operations.registry import parse_request
from ....schemas.wire.errors import ServiceError
from ...service.service import Service
from .service_node import SOCKET

FOLDER = "opt/robomaker/ros"
"""Folder below a run's root with the ROS message package and the socket."""
NODE = Path(__file__).with_name("service_node.py")

_MOST_BYTES = 64 << 10
_PATIENCE_S = 5.0
_LOOK_S = 0.2
_MAKE_S = 60.0
_CREDENTIALS = "3i"

_logger = logging.getLogger(__name__)


def make_message_package(argv: Sequence[str], variables: Mapping[str, str]) -> bool:
    """Builds the ROS message package of the job services, if necessary; returns whether it exists.

    A failure is logged, and not raised.

    Args:
        argv: Command line of `service_node.py make` with the Python of that ROS.
        variables: Environment variables of the launch.
    """
    environment = {"PATH": os.defpath, **variables}
    try:
        made = subprocess.run(argv, env=environment, capture_output=True, timeout=_MAKE_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        _logger.info("jobs have no ROS services: %s", error)
        return False
    if made.returncode:
        why = made.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        _logger.info("jobs have no ROS services: %s", why)
    return made.returncode == 0


def message_variables(folder: Path, variables: Mapping[str, str]) -> dict[str, str]:
    """Returns the variables by which a program finds the job services' ROS message package, after its own paths."""
    places = {"PYTHONPATH": folder / "python", "ROS_PACKAGE_PATH": folder / "share"}
    return {name: os.pathsep.join([*filter(None, [variables.get(name)]), str(place)]) for name, place in places.items()}


@contextmanager
def answering(root: Path | None, arn: str, service: Service) -> Generator[None]:
    """Answers ROS service calls of a job's programs, in a thread, inside the `with` block.

    Does nothing if the run has no folder of ROS services; replaces the socket that a dead job worker has left there.

    Args:
        root: Root folder of the run.
        arn: ARN of the job; the services act on no other job.
        service: The service, with its catalog and object store.
    """
    folder = root / FOLDER if root is not None else None
    if folder is None or not folder.is_dir():
        yield
        return
    place = os.open(folder, os.O_PATH)
    ended = threading.Event()
    with socket.socket(socket.AF_UNIX) as listener:
        with suppress(FileNotFoundError):
            os.unlink(SOCKET, dir_fd=place)  # of a job worker that died
        listener.bind(f"/proc/self/fd/{place}/{SOCKET}")
        listener.listen()
        listener.settimeout(_LOOK_S)
        thread = threading.Thread(target=_serve, args=(listener, ended, arn, service), name="ros-services")
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
            os.close(place)


def answer(question: object, arn: str, service: Service) -> dict[str, Any]:
    """Carries out a job's ROS service call (cancel the job, read or change its tags), and returns the answer.

    Args:
        question: Object with the member `operation`, which is `cancel`, `add_tags` with `tags`, `remove_tags` with
            `keys`, or `list_tags`.
        arn: ARN of the calling job.
        service: The service, with its catalog and object store.
    """
    members: Mapping[str, Any] = question if isinstance(question, dict) else {}
    tags: Mapping[str, str] = {}
    try:
        match members.get("operation"):
            case "cancel":
                service.catalog.request_cancel(arn)
            case "add_tags":
                asked = parse_request("TagResource", {"resourceArn": arn, "tags": members.get("tags")}).to_wire()
                service.catalog.set_tags(arn, asked["tags"])
            case "remove_tags":
                asked = parse_request("UntagResource", {"resourceArn": arn, "tagKeys": members.get("keys")}).to_wire()
                service.catalog.remove_tags(arn, asked["tagKeys"])
            case "list_tags":
                tags = service.catalog.get(arn).tags
            case other:
                return _told(f"operation: {other!r} has to be cancel, add_tags, remove_tags or list_tags")
    except ServiceError as error:
        return _told(str(error))
    return {"success": True, "message": "", "tags": dict(tags)}


def _told(problem: str) -> dict[str, Any]:
    return {"success": False, "message": problem, "tags": {}}


def _serve(listener: socket.socket, ended: threading.Event, arn: str, service: Service) -> None:
    while not ended.is_set():
        try:
            connection = listener.accept()[0]
        except TimeoutError:
            continue
        with connection:
            connection.settimeout(_PATIENCE_S)
            try:
                connection.sendall(json.dumps(_answer_to(connection, arn, service)).encode() + b"\n")
            except OSError as error:  # it has gone, or is slower than patience
                _logger.debug("a program of %s was not answered: %s", arn, error)
            except Exception:  # the next one may be right
                _logger.exception("a question of %s broke", arn)


def _answer_to(connection: socket.socket, arn: str, service: Service) -> dict[str, Any]:
    # Read first, also from others: a program that still writes when the connection ends learns no reason.
    with connection.makefile("rb") as question:
        line = question.readline(_MOST_BYTES)
    user = struct.unpack(
        _CREDENTIALS, connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize(_CREDENTIALS))
    )[1]
    if user != os.geteuid():
        return _told("only programs of the job's own user are answered")
    if not line.endswith(b"\n"):
        return _told(f"a question is one line of JSON of at most {_MOST_BYTES} bytes")
    try:
        asked = json.loads(line)
    except (ValueError, RecursionError) as error:
        return _told(f"a question is one line of JSON: {type(error).__name__}")
    return answer(asked, arn, service)
