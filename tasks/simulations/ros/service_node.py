"""The ROS 1 services of a job, a node that the run starts beside a launch: `/robomaker/job/cancel` and of tags.

    python3 service_node.py make FOLDER        makes the message package below FOLDER, where rospy and genpy are
    python3 service_node.py serve FOLDER       answers calls, by asking the job worker over the socket in FOLDER

ROS's own Python runs this file by itself, in the environment of the launch: it imports nothing of this package.
"""

from __future__ import annotations  # ROS 1's Python is 3.8, too

import json
import os
import socket
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

PACKAGE = "robomaker_simulation_msgs"
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
"""The package that nodes of RoboMaker jobs were built with: what their types are called and hashed by."""


def make(folder: str) -> int:
    """Writes the package's definitions to FOLDER/share, and what Python imports to FOLDER/python."""
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


def serve(folder: str) -> None:
    """Offers the services until the node is told to end."""
    rospy, msg, srv = import_module("rospy"), import_module(f"{PACKAGE}.msg"), import_module(f"{PACKAGE}.srv")

    def offer(service: Any, operation: str, members: Callable[[Any], dict[str, Any]] | None = None) -> None:
        def answer(request: Any) -> Any:
            told = ask(folder, {**(members(request) if members else {}), "operation": operation})
            reply = service._response_class(success=told["success"], message=told["message"])
            if operation == "list_tags":
                reply.tags = [msg.Tag(key=key, value=value) for key, value in sorted(told["tags"].items())]
            return reply

        rospy.Service(f"/robomaker/job/{operation}", service, answer)

    rospy.init_node("robomaker_job_services")
    offer(srv.Cancel, "cancel")
    offer(srv.AddTags, "add_tags", lambda request: {"tags": {tag.key: tag.value for tag in request.tags}})
    offer(srv.RemoveTags, "remove_tags", lambda request: {"keys": list(request.keys)})
    offer(srv.ListTags, "list_tags")
    rospy.spin()


def ask(folder: str, question: dict[str, Any]) -> dict[str, Any]:
    """Asks the job worker; what goes wrong on the way is an answer, too."""
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
    sys.exit({"make": make, "serve": serve}[sys.argv[1]](sys.argv[2]))
