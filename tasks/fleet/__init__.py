# pyright: reportUnsupportedDunderAll=false
"""Fleets and robots in the catalog, what robots and server say to each other, and bundles that updaters install.

May import: `schemas`, `tasks.catalog`, `tasks.fleet.agent`, `tasks.fleet.ddi`, `tasks.fleet.rollout`,
`tasks.fleet.swu`, `tasks.service`.
"""

__all__ = [
    "artifacts",
    "beginnings",
    "bundle_files",
    "kept_rollouts",
    "known_robots",
    "order_keeping",
    "order_watch",
    "records",
    "robot_reports",
    "signing_keys",
    "sources",
    "stored_rollouts",
]
