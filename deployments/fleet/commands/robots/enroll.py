"""Give a robot a token, and say how its updater or its agent is started.

The token is shown this once. `robomaker serve` lets the robot in a few seconds later. An agent gets a one-time token,
which it exchanges within an hour for one that it made itself.
"""

import argparse
import secrets
import shlex
from datetime import UTC, datetime
from typing import TYPE_CHECKING, NamedTuple

from ....cli.arguments import add_output
from ....cli.inputs.options import open_service
from ....cli.output.answers import print_either

if TYPE_CHECKING:
    from .....tasks.service.service import Service

_DEFAULT_URL = "http://127.0.0.1:8057"
_TENANT = "DEFAULT"


class Enrolment(NamedTuple):
    """Data with which a robot connects: server address, robot id, token and certificate."""

    url: str
    tenant: str
    controller_id: str
    token: str
    certificate: str

    @property
    def swupdate(self) -> list[str]:
        """The command line arguments for `swupdate` on the robot."""
        server = f"-t {self.tenant} -u {self.url} -i {self.controller_id} -k {self.token}"
        return ["-k", "certificate.pem", "-H", "robot:1.0", "-u", server]


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker robots enroll` to its parser."""
    parser.add_argument("name", metavar="NAME", help="name of the robot, as in CreateRobot")
    parser.add_argument("--agent", action="store_true", help="for our own agent; without it, for updaters of hawkBit")
    parser.add_argument("--rotate", action="store_true", help="replace the token that it has")
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker robots enroll`: gives a robot a login token and prints its connection data."""
    from .....schemas.fleet.settings import FleetSettings

    service = open_service()
    url = (FleetSettings.of(service.settings).robots_url or _DEFAULT_URL).rstrip("/")
    return (_enrol_agent if arguments.agent else _enrol_updater)(arguments, url, service)


def _enrol_agent(arguments: argparse.Namespace, url: str, service: "Service") -> int:
    from .....tasks.fleet.fleet_records import enrollable
    from .....tasks.fleet.trust.enrolment_tokens import offer

    robot = enrollable(arguments.name, service)
    token = offer(robot, service, secrets.token_bytes, rotate=arguments.rotate)
    expires = datetime.fromtimestamp(int(token.expires_s), UTC).isoformat()
    words = ["robomaker-agent", "enroll", token.text, "--url", url, "--name", arguments.name]
    members = {"url": url, "controller_id": arguments.name, "token": token.text, "expires": expires, "agent": words}
    told = [f"On the robot, until {expires}, once:", "", f"  {shlex.join(words)}"]
    print_either(arguments.output, {"schema_version": 1, **members}, told)
    return 0


def _enrol_updater(arguments: argparse.Namespace, url: str, service: "Service") -> int:
    from .....tasks.fleet.artifacts import certificate_path, signing_key
    from .....tasks.fleet.fleet_records import enrol

    signing_key(service)  # before there is a token that would be lost if this failed
    token = enrol(arguments.name, service, secrets.token_bytes, rotate=arguments.rotate)
    enrolment = Enrolment(url, _TENANT, arguments.name, token, str(certificate_path(service)))
    answer = {"schema_version": 1, **enrolment._asdict(), "swupdate": enrolment.swupdate}
    print_either(arguments.output, answer, _lines(enrolment))
    return 0


def _lines(enrolment: Enrolment) -> list[str]:
    rows = [f"{name.replace('_', ' ') + ':':<15}{value}" for name, value in enrolment._asdict().items()]
    told = ["", "The token is not shown again. With the certificate copied to the robot, it runs:", ""]
    return [*rows, *told, f"  swupdate {shlex.join(enrolment.swupdate)}"]
