"""The ROS services of a job, a node that the run starts beside a launch: `/robomaker/job/cancel` and of tags.

    python3 service_node.py make 1 FOLDER      makes the message package below FOLDER, where rospy and genpy are
    python3 service_node.py make 2 FOLDER      fails unless rclpy is there, and the workspace has the message package
    python3 service_node.py serve 1|2 FOLDER   answers calls, by asking the job worker over the socket in FOLDER

ROS's own Python runs this file by itself, in the environment of the launch: it imports nothing of this package.
"""

from __future__ import annotations  # ROS 1's Python is 3.8, too

import json
import os
import socket
import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

PACKAGE = "robomaker_simulation_msgs"
NAME = "robomaker_job_services"
SOCKET = "job.sock"
ANSWER = "bool success\nstring message\n"
FILES = {
    "msg/Tag.msg": "string key\nstring value\n",
    "srv/Cancel.srv": "---\n" + ANSWER,
    "srv/AddTags.srv": "Tag[] tags\n---\n" + ANSWER,
    "srv/RemoveTags.srv": "string[] keys\n---\n" + ANSWER,
    "srv/ListTags.srv": "---\n" + ANSWER + "Tag[] tags\n",
    "package.xml": f'<package format="2"><name>{PACKAGE}'
    "</name><version>1.1.0</version>"
    "<description>The messages of a job's services.</description>"
    '<maintainer email="jobs@example.com">robomaker</maintainer><license>Apache-2.0</license></package>\n',
}
"""Files of the ROS message package with which nodes of RoboMaker jobs were built; they determine type names and hashes.
"""
SERVICES: dict[str, tuple[str, Callable[[Any], dict[str, Any]]]] = {
    "cancel": ("Cancel", lambda _: {}),
    "add_tags": ("AddTags", lambda request: {"tags": {tag.key: tag.value for tag in request.tags}}),
    "remove_tags": ("RemoveTags", lambda request: {"keys": list(request.keys)}),
    "list_tags": ("ListTags", lambda _: {}),
}
"""Types of the services by name, and functions that read a request's members for the job worker."""


def make(folder: str) -> int:
    """Writes the ROS message package of the job's services (definitions and Python modules) into a folder.

    Returns 0, or another number if a message could not be generated. Raises `ImportError` if ROS has no `rospy`.
    """
    import_module("rospy")  # the node needs it; where it is missing, the package is of no use
    generator, inits = import_module("genpy.generator"), import_module("genpy.generate_initpy")
    share, modules = (Path(folder, part, PACKAGE) for part in ("share", "python"))
    for name, text in FILES.items():
        (share / name).parent.mkdir(parents=True, exist_ok=True)
        (share / name).write_text(text)
    failed = 0
    for kind, maker in (("msg", generator.MsgGenerator()), ("srv", generator.SrvGenerator())):
        definitions = [str(share / name) for name in FILES if name.startswith(kind)]
        target = str(modules / kind)
        failed |= maker.generate_messages(PACKAGE, definitions, target, {PACKAGE: [str(share / "msg")]})
        inits.write_modules(target)
    (modules / "__init__.py").touch()
    return failed


def check_installed(_folder: str) -> int:
    """Returns 0 if ROS 2 and the message package of the job services are installed; else raises ImportError."""
    import_module("rclpy")
    import_module(f"{PACKAGE}.srv")
    return 0


def serve(folder: str) -> None:
    """Runs the ROS 1 node that offers the job's services (cancelling and tags) until ROS ends it."""
    rospy, srv = import_module("rospy"), import_module(f"{PACKAGE}.srv")

    def answering(operation: str, service: Any) -> Callable[[Any], Any]:
        return lambda request: answered(folder, operation, request, service._response_class())

    rospy.init_node(NAME)
    for operation, (name, _) in SERVICES.items():
        service = getattr(srv, name)
        rospy.Service(f"/robomaker/job/{operation}", service, answering(operation, service))
    rospy.spin()


def serve_2(folder: str) -> None:
    """Runs the ROS 2 node that offers the job's services (cancelling and tags) until ROS ends it."""
    rclpy, srv = import_module("rclpy"), import_module(f"{PACKAGE}.srv")
    rclpy.init()
    node = rclpy.create_node(NAME)
    for operation, (name, _) in SERVICES.items():
        node.create_service(getattr(srv, name), f"/robomaker/job/{operation}", partial(answered, folder, operation))
    rclpy.spin(node)


def answered(folder: str, operation: str, request: Any, response: Any) -> Any:
    """Passes a ROS service request on to the job worker, and returns the response, filled with the worker's answer."""
    told = ask(folder, {**SERVICES[operation][1](request), "operation": operation})
    response.success, response.message = told["success"], told["message"]
    if operation == "list_tags":
        tag = import_module(f"{PACKAGE}.msg").Tag
        response.tags = [tag(key=key, value=value) for key, value in sorted(told["tags"].items())]
    return response


def ask(folder: str, question: dict[str, Any]) -> dict[str, Any]:
    """Sends a request to the job worker's socket in a folder, and returns the worker's answer, waiting up to 30 s.

    If the worker does not answer, the answer says so, with `success` false; no error is raised.
    """
    place = os.open(folder, os.O_PATH)
    try:
        with socket.socket(socket.AF_UNIX) as worker:
            worker.settimeout(30)
            # Paths of sockets are short; that of a run's folder may not be.
            worker.connect(f"/proc/self/fd/{place}/{SOCKET}")
            worker.sendall(json.dumps(question).encode() + b"\n")
            with worker.makefile("rb") as told:
                return json.loads(told.readline())
    except (OSError, ValueError) as error:
        return {"success": False, "message": f"the job worker does not answer: {error}", "tags": {}}
    finally:
        os.close(place)


if __name__ == "__main__":
    task, ros, place = sys.argv[1:]
    sys.exit({"make 1": make, "make 2": check_installed, "serve 1": serve, "serve 2": serve_2}[f"{task} {ros}"](place))
