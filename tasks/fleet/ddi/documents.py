"""The documents that robots read: the base, an order, a cancellation. Links in them are absolute."""

import json
from typing import Any

from .open_orders import RobotState
from .orders import RobotOrder

LAUNCH_KEY = "robomaker.launch"
"""Key of the metadata of an order's chunk that says what to launch: a `DeploymentLaunchConfig` as JSON text."""

TARGET_KEY = "robomaker.target"
"""Key of the metadata that names the signed deployment document, which is all that an agent goes by."""

TAGS_KEY = "robomaker.tags"
"""Key of the metadata with the robot's tags: an object of texts as JSON. They are not signed."""

_MAX_SLEEP_S = 24 * 3600 - 1


def base_document(robot_url: str, state: RobotState, sleep_s: int) -> bytes:
    """The answer to a poll: when to poll again, and at most one thing to do.

    Args:
        robot_url: absolute address of the robot's base, without a slash at the end.
        state: what is open for the robot.
        sleep_s: seconds until its next poll, 1 s to a day.
    """
    links: dict[str, Any] = {}
    if state.order is not None:
        kind = "cancelAction" if state.is_cancelling else "deploymentBase"
        links[kind] = {"href": f"{robot_url}/{kind}/{state.order.action_id}"}
    if state.wants_attributes:
        links["configData"] = {"href": f"{robot_url}/configData"}
    return _json({"config": {"polling": {"sleep": _clock_time(sleep_s)}}, "_links": links})


def order_document(robot_url: str, order: RobotOrder) -> bytes:
    """An order, for the one robot it is for.

    Both steps are forced: SWUpdate takes `skip` for success without installing, and knows no maintenance windows.

    Args:
        robot_url: absolute address of the robot's base, without a slash at the end.
        order: the order.
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
    """The cancellation of an order; both have the same id."""
    return _json({"id": str(action_id), "cancelAction": {"stopId": str(action_id)}})


def _clock_time(sleep_s: int) -> str:
    seconds = max(1, min(sleep_s, _MAX_SLEEP_S))
    return f"{seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}"


def _json(document: dict[str, Any]) -> bytes:
    return json.dumps(document, separators=(",", ":")).encode()
