"""HTTP client of the update server for robots: hawkBit's Direct Device Integration, with the standard library only.

Each request has a connection of its own: servers drop idle ones long before the next poll.
"""

from __future__ import annotations

import http.client
import json
import re
import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any
from urllib.parse import urlsplit

from .deployment import Order
from .errors import AgentError, TryLater
from .settings import Connection
from .state_machine import End

MAX_BODY_BYTES = 1 << 20
TIMEOUT_S = 15.0
TARGET_KEY = "robomaker.target"
TAGS_KEY = "robomaker.tags"

_SLEEP = re.compile(r"(\d{1,2}):(\d{2}):(\d{2})")
_LINK = re.compile(r"/(deploymentBase|cancelAction)/(\d{1,10})(?:[?/]|$)")
_MAX_DETAIL = 500


@dataclass(frozen=True)
class Poll:
    """Answer of the update server to a poll."""

    sleep_s: float
    order: int | None = None
    cancel: int | None = None
    wants_attributes: bool = False


class Refused(AgentError):
    """Raised when the update server refused a request."""

    def __init__(self, status: int, path: str) -> None:
        super().__init__(f"it answers {path or 'polls'} with HTTP status {status}")
        self.status = status
        """HTTP status of the update server's refusal."""


def connect(connection: Connection, timeout_s: float = TIMEOUT_S) -> http.client.HTTPConnection:
    """Makes an HTTP or HTTPS connection to the update server, by its URL; it is opened by the first request."""
    parts = urlsplit(connection.url)
    assert parts.hostname is not None
    if parts.scheme == "https":
        return http.client.HTTPSConnection(
            parts.hostname, parts.port, timeout=timeout_s, context=_trusted_certificates()
        )
    return http.client.HTTPConnection(parts.hostname, parts.port, timeout=timeout_s)


@lru_cache(maxsize=1)
def _trusted_certificates() -> ssl.SSLContext:
    """Returns the CA certificates of the machine, cached: reading them takes longer than a poll."""
    return ssl.create_default_context()


def exchange(
    connection: Connection, method: str, path: str, body: bytes | None, headers: Mapping[str, str]
) -> tuple[int, bytes]:
    """Sends one HTTP request; returns status and body.

    Raises:
        TryLater: There is no answer.
    """
    link = connect(connection)
    try:
        link.request(method, path, body=body, headers={"Connection": "close", **headers})
        answer = link.getresponse()
        return answer.status, answer.read(MAX_BODY_BYTES)
    except (OSError, http.client.HTTPException) as error:
        _trusted_certificates.cache_clear()  # the machine's may have been renewed
        raise TryLater(f"{connection.url}: {error or type(error).__name__}") from error
    finally:
        link.close()


class Server:
    """Client of the update server on a robot.

    Args:
        connection: URL, tenant, name and token of the robot.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def poll(self) -> Poll:
        """Asks the server whether there is an order.

        Raises:
            TryLater: There is no answer.
            Refused: The robot is not let in.
        """
        content = self._get("")
        links = content.get("_links")
        hrefs = [
            link.get("href") for link in (links.values() if isinstance(links, dict) else []) if isinstance(link, dict)
        ]
        found = {match[1]: int(match[2]) for match in (_LINK.search(str(href)) for href in hrefs) if match}
        return Poll(
            _sleep_s(content.get("config")),
            found.get("deploymentBase"),
            found.get("cancelAction"),
            isinstance(links, dict) and "configData" in links,
        )

    def order(self, action_id: int) -> Order | None:
        """Reads a robot's order from the update server; `None` if the order no longer exists.

        Raises:
            TryLater: There is no answer.
        """
        try:
            content = self._get(f"/deploymentBase/{action_id}")
        except Refused:
            return None
        try:
            metadata = content["deployment"]["chunks"][0]["metadata"]
            entries = {entry["key"]: entry["value"] for entry in metadata}
            tags = json.loads(entries.get(TAGS_KEY, "{}"))
            return Order(action_id, str(entries[TARGET_KEY]), {str(key): str(value) for key, value in tags.items()})
        except (LookupError, TypeError, ValueError, AttributeError):
            return Order(action_id, "")

    def tell_end(self, end: End) -> bool:
        """Reports how an order ended; returns whether the server knows it now.

        Raises:
            TryLater: There is no answer, or it could not be stored.
        """
        kind = "cancelAction" if end.execution == "canceled" else "deploymentBase"
        status: dict[str, Any] = {"execution": end.execution, "result": {"finished": end.finished}}
        if end.code is not None:
            status["code"] = end.code
        status["details"] = [detail[:_MAX_DETAIL] for detail in end.details]
        answer = self._post(f"/{kind}/{end.order.action_id}/feedback", {"status": status})
        if answer == 405 and kind == "cancelAction":  # the cancellation was taken back: it is the order's end then
            answer = self._post(f"/deploymentBase/{end.order.action_id}/feedback", {"status": status})
        return answer in (200, 404, 405, 410)

    def tell_step(self, action_id: int, step: str, percent: int | None) -> None:
        """Reports the current step; a refusal is ignored.

        Raises:
            TryLater: There is no answer.
        """
        result: dict[str, Any] = {"finished": "none"}
        if percent is not None:
            result["progress"] = {"cnt": percent, "of": 100}
        status = {"execution": "proceeding", "result": result, "details": [step]}
        self._post(f"/deploymentBase/{action_id}/feedback", {"status": status})

    def refuse_cancellation(self, action_id: int) -> None:
        """Reports that an order can no longer be cancelled.

        Raises:
            TryLater: There is no answer.
        """
        status = {
            "execution": "rejected",
            "result": {"finished": "none"},
            "details": ["the new version is being tried"],
        }
        self._post(f"/cancelAction/{action_id}/feedback", {"status": status})

    def tell_attributes(self, attributes: Mapping[str, str]) -> bool:
        """Reports the robot's attributes; returns whether the server has taken them.

        Raises:
            TryLater: There is no answer.
        """
        status, _ = self._send("PUT", "/configData", {"mode": "merge", "data": dict(attributes)})
        return status < 300

    def _get(self, path: str) -> dict[str, Any]:
        status, body = self._send("GET", path, None)
        if status != 200:
            raise Refused(status, path)
        try:
            content = json.loads(body)
        except ValueError:
            content = None
        if not isinstance(content, dict):  # a portal of a network in between answers so
            raise TryLater(f"{self._connection.url}: the answer is no JSON object")
        return content

    def _post(self, path: str, content: Mapping[str, Any]) -> int:
        status, _ = self._send("POST", path, content)
        return status

    def _send(self, method: str, path: str, content: Mapping[str, Any] | None) -> tuple[int, bytes]:
        connection = self._connection
        headers = {"Authorization": f"TargetToken {connection.token}", "Accept": "application/hal+json"}
        body = None
        if content is not None:
            body, headers["Content-Type"] = json.dumps(content).encode(), "application/json"
        status, answer = exchange(connection, method, connection.base + path, body, headers)
        if status >= 500:
            raise TryLater(f"{connection.url}: the server answered {status}")
        return status, answer


def _sleep_s(config: Any) -> float:
    polling = config.get("polling") if isinstance(config, dict) else None
    found = _SLEEP.fullmatch(str(polling.get("sleep") if isinstance(polling, dict) else ""))
    if found is None:
        return 30.0
    hours, minutes, seconds = (int(part) for part in found.groups())
    return float(max(1, hours * 3600 + minutes * 60 + seconds))
