"""Orders for robots, and robots that are let in."""

import hashlib
from typing import Any

from prefect_robomaker.tasks.fleet.ddi.open_orders import OpenOrders
from prefect_robomaker.tasks.fleet.ddi.orders import RobotOrder
from prefect_robomaker.tasks.fleet.ddi.robot_tokens import hash_token

TOKEN = "0123456789abcdef" * 4


def robot_order(content: bytes = b"content", /, **changes: Any) -> RobotOrder:
    """An order for `robot1` with the file `app.swu`; keyword arguments are other members."""
    members = {
        "action_id": 8,
        "robot": "robot1",
        "name": "app",
        "version": "3",
        "file_name": "app.swu",
        "size_bytes": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
        "sha1": hashlib.sha1(content).hexdigest(),
        "md5": hashlib.md5(content).hexdigest(),
    }
    return RobotOrder.model_validate({**members, **changes})


def table_of_robots(*robots: str) -> OpenOrders:
    """A table with robots that all have `TOKEN`."""
    orders = OpenOrders()
    for robot in robots or ("robot1",):
        orders.enrol(robot, hash_token(TOKEN))
    return orders
