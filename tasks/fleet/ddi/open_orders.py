"""Table of robots in memory: hashes of their tokens, and the one update order that each may have open.

```
            offer                 cancel
  nothing ────────> open ─────────────────────> cancelling
     ^               │  close                       │  close
     │   withhold    │ <────────────────────────────│
     │               │            carry_on          │
     └───────────────┴──────────────────────────────┘
```

A robot has at most one order. One that replaces it has to wait until the robot closed it, also when it was cancelled:
SWUpdate is stuck for ever when an order is exchanged under it.
"""

import json
import threading
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from ....schemas.wire.errors import ResourceNotFoundException, StateConflictError
from .orders import RobotOrder
from .received_reports import Feedback
from .robot_tokens import is_token

MAX_FEEDBACKS = 1000
"""Limit of the accepted feedback messages about one order; one that ends the order is always accepted."""

_NO_HASH = bytes(32)


@dataclass(frozen=True)
class RobotState:
    """State of one robot in the update server: its token, its open order, and its last feedback."""

    token_hash: bytes
    order: RobotOrder | None = None
    """Open update order of a robot; `None`: it has none."""

    is_cancelling: bool = False
    """Whether a robot is asked to cancel its update order."""

    is_fetched: bool = False
    """Whether a robot has read its update order."""

    feedbacks: int = 0
    """Number of a robot's feedback messages about its update order."""

    is_expected: bool = False
    """Whether an order will follow soon, so that the robot polls as often as with one."""

    wants_attributes: bool = True
    """Whether the robot is asked to report its attributes."""

    last_action_id: int = 0
    """Number of the newest order that the robot ever had here."""

    last_feedback: Feedback | None = None
    """Feedback message of a robot that closed its last update order."""

    def has(self, action_id: int) -> bool:
        """Whether the robot has an open update order of this action id."""
        return self.order is not None and self.order.action_id == action_id


class OpenOrders:
    """Table in memory of all robots and their open update orders; its methods may be called from any thread.

    Each robot's state is one frozen value, which changes replace, so a poll reads it without waiting for a lock.
    """

    def __init__(self) -> None:
        self._robots: dict[str, RobotState] = {}
        self._lock = threading.Lock()
        self.active = 0
        """Number of robots that had an order or were to get one soon, when they were last counted."""

    def enrol(self, robot: str, token_hash: bytes) -> None:
        """Adds a robot to the table, by the hash of its token (`hash_token`); a known robot gets the new token."""
        with self._lock:
            known = self._robots.get(robot)
            self._robots[robot] = replace(known, token_hash=token_hash) if known else RobotState(token_hash)

    def expel(self, robot: str) -> None:
        """Removes a robot, its token and its order; does nothing if it is unknown."""
        with self._lock:
            self._robots.pop(robot, None)

    def check_token(self, robot: str, token: bytes | None) -> RobotState | None:
        """Returns the state of the robot if the token is right; `None` if robot or token is wrong."""
        state = self._robots.get(robot)
        is_right = is_token(token or b"", state.token_hash if state else _NO_HASH)
        return state if is_right and token else None

    def state(self, robot: str) -> RobotState:
        """Returns the state of a robot.

        Raises:
            ResourceNotFoundException: The robot is not enrolled.
        """
        try:
            return self._robots[robot]
        except KeyError:
            raise ResourceNotFoundException(f"robot {robot} is not enrolled") from None

    def open(self) -> dict[str, RobotOrder]:
        """Returns all open update orders, by robot."""
        with self._lock:
            return {robot: state.order for robot, state in self._robots.items() if state.order is not None}

    def count_active(self) -> None:
        """Counts the robots that have an order, or expect one soon, and sets `active`."""
        with self._lock:
            self.active = sum(state.order is not None or state.is_expected for state in self._robots.values())

    def offer(self, order: RobotOrder) -> None:
        """Gives a robot an update order; does nothing if the robot has the same order already.

        Raises:
            ResourceNotFoundException: The robot is not in.
            StateConflictError: The robot has another order open, or had this one before.
        """
        with self._lock:
            state = self.state(order.robot)
            if state.order == order:
                return
            if state.order is not None:
                raise StateConflictError(
                    f"robot {order.robot} has order {state.order.action_id} open: "
                    f"close it before order {order.action_id}, or cancel it and wait for the robot's answer"
                )
            if order.action_id <= state.last_action_id:
                raise StateConflictError(
                    f"robot {order.robot} had order {state.last_action_id} already: "
                    f"order {order.action_id} needs a larger action id"
                )
            self._robots[order.robot] = replace(
                state,
                order=order,
                is_fetched=False,
                feedbacks=0,
                last_action_id=order.action_id,
                last_feedback=None,
            )

    def cancel(self, robot: str, action_id: int) -> bool:
        """Asks a robot to cancel its order; returns false if the order is not open."""
        return self._change(robot, action_id, is_cancelling=True)

    def carry_on(self, robot: str, action_id: int) -> bool:
        """Stops asking a robot to cancel its order, which the robot refused; returns false if it is not open."""
        return self._change(robot, action_id, is_cancelling=False)

    def close(self, robot: str, action_id: int, feedback: Feedback | None = None) -> bool:
        """Removes a robot's finished order; returns false if it is not open.

        Args:
            robot: Id of the robot.
            action_id: Id of the order's action.
            feedback: The robot's last feedback; its repetition is then no error.
        """
        return self._change(robot, action_id, order=None, is_cancelling=False, last_feedback=feedback)

    def withhold(self, robot: str, action_id: int) -> bool:
        """Withdraws an order that the robot has not read; returns false if it has, or the order is not open."""
        with self._lock:
            state = self._robots.get(robot)
            if state is None or not state.has(action_id) or state.is_fetched or state.is_cancelling:
                return False
            self._robots[robot] = replace(state, order=None, last_action_id=action_id - 1)
            return True

    def mark_fetched(self, robot: str, action_id: int) -> bool:
        """Records that a robot has read its order; returns false if the order is not open."""
        return self._change(robot, action_id, is_fetched=True)

    def count_feedback(self, robot: str, action_id: int) -> int:
        """Counts one more feedback about an open order and returns the count; 0 if the order is not open."""
        with self._lock:
            state = self._robots.get(robot)
            if state is None or not state.has(action_id):
                return 0
            self._robots[robot] = replace(state, feedbacks=state.feedbacks + 1)
            return state.feedbacks + 1

    def expect(self, robots: Iterable[str], *, is_expected: bool = True) -> None:
        """Marks robots that will get an order soon, so that they poll more often, or unmarks them."""
        with self._lock:
            for robot in robots:
                if (state := self._robots.get(robot)) is not None:
                    self._robots[robot] = replace(state, is_expected=is_expected)

    def ask_attributes(self, robot: str, *, wants_attributes: bool = True) -> None:
        """Marks whether a robot is asked to report its attributes; an unknown robot is ignored."""
        with self._lock:
            if (state := self._robots.get(robot)) is not None:
                self._robots[robot] = replace(state, wants_attributes=wants_attributes)

    def _change(self, robot: str, action_id: int, **changes: object) -> bool:
        with self._lock:
            state = self._robots.get(robot)
            if state is None or not state.has(action_id):
                return False
            self._robots[robot] = replace(state, **changes)  # type: ignore[arg-type]
            return True


LAUNCH_KEY = "robomaker.launch"
"""Metadata key of an order's chunk with the launch configuration: a `DeploymentLaunchConfig` as JSON text."""

TARGET_KEY = "robomaker.target"
"""Metadata key of an order's chunk with the path of the signed deployment document, the only part that agents use."""

TAGS_KEY = "robomaker.tags"
"""Metadata key of an order's chunk with the robot's tags: a JSON object of texts. They are not signed."""

_MAX_SLEEP_S = 24 * 3600 - 1


def base_document(robot_url: str, state: RobotState, sleep_s: int) -> bytes:
    """Makes the JSON answer to a robot's poll, as in hawkBit's DDI protocol.

    It says when the robot polls next. It has a link to an update to install (`deploymentBase`) or to the cancellation
    of one (`cancelAction`) if there is an open order, and a link for reporting the robot's attributes (`configData`)
    if they are asked for.

    Args:
        robot_url: Absolute address of the robot's base, without a slash at the end.
        state: Open orders of the robot.
        sleep_s: Seconds until its next poll, 1 s to a day.
    """
    links: dict[str, Any] = {}
    if state.order is not None:
        kind = "cancelAction" if state.is_cancelling else "deploymentBase"
        links[kind] = {"href": f"{robot_url}/{kind}/{state.order.action_id}"}
    if state.wants_attributes:
        links["configData"] = {"href": f"{robot_url}/configData"}
    return _json({"config": {"polling": {"sleep": _clock_time(sleep_s)}}, "_links": links})


def order_document(robot_url: str, order: RobotOrder) -> bytes:
    """Makes the JSON of an update order for one robot.

    Both steps are forced: SWUpdate takes `skip` for success without installing, and knows no maintenance windows.

    Args:
        robot_url: Absolute address of the robot's base, without a slash at the end.
        order: The order.
    """
    link = {"href": f"{robot_url}/softwaremodules/{order.action_id}/artifacts/{order.file_name}"}
    scheme = "download" if robot_url.startswith("https:") else "download-http"
    artifact = {
        "filename": order.file_name,
        "hashes": {"sha1": order.sha1, "md5": order.md5, "sha256": order.sha256},
        "size": order.size_bytes,
        "_links": {"download": link, scheme: link},
    }
    chunk: dict[str, Any] = {
        "part": "bApp",
        "version": order.version,
        "name": order.name,
        "artifacts": [artifact],
    }
    if metadata := _metadata(order):
        chunk["metadata"] = [{"key": key, "value": value} for key, value in metadata.items()]
    deployment = {"download": "forced", "update": "forced", "chunks": [chunk]}
    return _json({"id": str(order.action_id), "deployment": deployment})


def _metadata(order: RobotOrder) -> dict[str, str]:
    found: dict[str, str] = {}
    if order.launch is not None:
        found[LAUNCH_KEY] = order.launch.model_dump_json(by_alias=True, exclude_none=True)
    if order.target is not None:
        found[TARGET_KEY] = order.target
    if order.tags is not None:
        found[TAGS_KEY] = json.dumps(order.tags)
    return found


def cancel_document(action_id: int) -> bytes:
    """Makes the JSON that asks a robot to cancel an order; both have the same id."""
    return _json({"id": str(action_id), "cancelAction": {"stopId": str(action_id)}})


def _clock_time(sleep_s: int) -> str:
    seconds = max(1, min(sleep_s, _MAX_SLEEP_S))
    return f"{seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}"


def _json(document: dict[str, Any]) -> bytes:
    return json.dumps(document, separators=(",", ":")).encode()
