"""Robots at `robomaker serve`: the door beside the endpoint, on orders and files that the catalog and the store have.

May import: `schemas`, `tasks`, `deployments.robot_door`, `starlette`'s types.
"""

__all__ = ["mounting"]
