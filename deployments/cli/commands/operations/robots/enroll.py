"""Give a robot a token, and say how its updater is started.

The token is shown this once. `robomaker serve` lets the robot in a few seconds later.
"""

import argparse
import json
import os
import secrets
import shlex
import sys
from typing import NamedTuple

from ....arguments import add_output

_DEFAULT_URL = "http://127.0.0.1:8057"
_TENANT = "DEFAULT"


class Enrolment(NamedTuple):
    """What a robot needs."""

    url: str
    tenant: str
    controller_id: str
    token: str
    certificate: str

    @property
    def swupdate(self) -> list[str]:
        """The words behind `swupdate`."""
        server = f"-t {self.tenant} -u {self.url} -i {self.controller_id} -k {self.token}"
        return ["-k", "certificate.pem", "-H", "robot:1.0", "-u", server]


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    parser.add_argument("name", metavar="NAME", help="name of the robot, as in CreateRobot")
    parser.add_argument("--rotate", action="store_true", help="replace the token that it has")
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Stores the token's hash; prints the token and what the robot needs besides."""
    from ......schemas.settings import Settings
    from ......tasks.fleet.known_robots import enrol
    from ......tasks.fleet.signing_keys import certificate_path, signing_key
    from ......tasks.service.service import Service

    service = Service.open(Settings.from_environment(os.environ))
    signing_key(service)  # before there is a token that would be lost if this failed
    token = enrol(arguments.name, service, secrets.token_bytes, rotate=arguments.rotate)
    url = (service.settings.robots_url or _DEFAULT_URL).rstrip("/")
    enrolment = Enrolment(url, _TENANT, arguments.name, token, str(certificate_path(service)))
    if arguments.output == "json":
        answer = {"schema_version": 1, **enrolment._asdict(), "swupdate": enrolment.swupdate}
        sys.stdout.write(json.dumps(answer, indent=2) + "\n")
    else:
        sys.stdout.write(_text(enrolment))
    return 0


def _text(enrolment: Enrolment) -> str:
    rows = [f"{name.replace('_', ' ') + ':':<15}{value}" for name, value in enrolment._asdict().items()]
    told = ["", "The token is not shown again. With the certificate copied to the robot, it runs:", ""]
    return "\n".join([*rows, *told, f"  swupdate {shlex.join(enrolment.swupdate)}"]) + "\n"
