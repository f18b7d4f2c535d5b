"""URLs of the update server: which robot and resource a path names, and the base URL of a robot."""

import re
from dataclasses import dataclass
from typing import Literal
from urllib.parse import urlsplit

from starlette.types import Scope

from ....schemas.wire.errors import ConfigurationError
from ....tasks.fleet.ddi.orders import ROBOT_ID
from .robot_answers import DoorRefusal

Resource = Literal[
    "base",
    "order",
    "order_feedback",
    "cancel",
    "cancel_feedback",
    "attributes",
    "artifact",
    "metadata",
    "target",
    "enrolment",
]

METHODS: dict[Resource, tuple[str, ...]] = {
    "base": ("GET",),
    "order": ("GET",),
    "order_feedback": ("POST",),
    "cancel": ("GET",),
    "cancel_feedback": ("POST",),
    "attributes": ("PUT",),
    "artifact": ("GET", "HEAD"),
    "metadata": ("GET",),
    "target": ("GET", "HEAD"),
    "enrolment": ("POST",),
}

_REST = re.compile(
    r"(?P<base>)|(?P<attributes>/configData)"
    r"|(?P<order>/deploymentBase/(?P<order_id>[0-9]{1,10}))(?P<order_feedback>/feedback)?"
    r"|(?P<cancel>/cancelAction/(?P<cancel_id>[0-9]{1,10}))(?P<cancel_feedback>/feedback)?"
    r"|(?P<artifact>/softwaremodules/(?P<artifact_id>[0-9]{1,10})/artifacts/(?P<file>[^/]+))"
    r"|/repository/(?:metadata/(?P<metadata>[^/]+)|targets/(?P<target>.+))"
)
_HOST = re.compile(r"[A-Za-z0-9._-]{1,253}(:[0-9]{1,5})?|\[[0-9A-Fa-f:.]{2,45}\](:[0-9]{1,5})?")
_TENANT = re.compile(r"[A-Za-z0-9_-]{1,64}")


@dataclass(frozen=True)
class Address:
    """Robot and resource that a URL path of the update server names."""

    robot: str
    resource: Resource
    action_id: int = 0
    file: str = ""
    """Name of the installation file, or of the file in the TUF repository, in a URL path."""


class Addresses:
    """Parses and makes the URLs of the update server for robots (hawkBit's DDI API).

    Args:
        tenant: First part of every path; hawkBit's own is `DEFAULT`.
        public_url: URL of this server for robots, such as `https://fleet.example.com`, without a path; `None`: as
            each request's `Host` says, which is right where no proxy is in between.

    Raises:
        ConfigurationError: The URL or the tenant is invalid.
    """

    def __init__(self, tenant: str, public_url: str | None) -> None:
        if not _TENANT.fullmatch(tenant):
            raise ConfigurationError(f"tenant: {tenant!r} is not right; 1 to 64 letters, digits, '-' and '_' are")
        self.prefix = f"/{tenant}/controller/v1/"
        """URL path prefix of robots at the update server."""

        self.enrolment_prefix = f"/{tenant}/agents/v1/"
        """URL path prefix at which robot agents enrol."""

        self._enrolment = re.compile(rf"{re.escape(self.enrolment_prefix)}(?P<robot>{ROBOT_ID})/enrolment/?")
        self._path = re.compile(rf"{re.escape(self.prefix)}(?P<robot>{ROBOT_ID})(?:{_REST.pattern})/?")
        self._public_url = None if public_url is None else _checked(public_url)

    def read(self, path: str) -> Address:
        """Parses a URL path into its robot and resource.

        Raises:
            DoorRefusal: Nothing (404).
        """
        if (enrolment := self._enrolment.fullmatch(path)) is not None:
            return Address(enrolment["robot"], "enrolment")
        found = self._path.fullmatch(path)
        if found is None:
            raise DoorRefusal(404, "there is nothing at this path")
        parts = found.groupdict()
        number = parts["order_id"] or parts["cancel_id"] or parts["artifact_id"] or "0"
        for resource in ("metadata", "target"):
            if parts[resource]:
                return Address(parts["robot"], resource, file=parts[resource])
        for resource in ("order_feedback", "cancel_feedback", "order", "cancel", "attributes", "artifact"):
            if parts[resource]:
                return Address(parts["robot"], resource, int(number), parts["file"] or "")
        return Address(parts["robot"], "base")

    def robot_url(self, scope: Scope, host: bytes | None, robot: str) -> str:
        """Returns the absolute base URL of a robot.

        Args:
            scope: ASGI scope of the request.
            host: Header `Host` of the request.
            robot: The robot.

        Raises:
            DoorRefusal: The request's `Host` is none, and no public address is configured (400).
        """
        origin = self._public_url
        if origin is None:
            name = (host or b"").decode("latin-1")
            if not _HOST.fullmatch(name):
                raise DoorRefusal(400, f"Host: {ascii(name)[:60]} is no name of a server")
            origin = f"{scope.get('scheme', 'http')}://{name}"
        return f"{origin}{self.prefix}{robot}"


def _checked(url: str) -> str:
    parts = urlsplit(url)
    is_right = parts.scheme in ("http", "https") and _HOST.fullmatch(parts.netloc)
    if not is_right or parts.path.strip("/") or parts.query or parts.fragment:
        raise ConfigurationError(
            f"public URL: {url!r} is not right; scheme, name and port are, such as https://fleet.example.com:8443"
        )
    return f"{parts.scheme}://{parts.netloc}"
