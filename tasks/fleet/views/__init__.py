# pyright: reportUnsupportedDunderAll=false
"""Fleets seen: how they and their deployments stand, and the report of a deployment.

May import: `schemas`, `tasks.catalog`, `tasks.fleet`, `tasks.fleet.rollout`, `tasks.reporting`, `tasks.service`.
"""

__all__ = ["finding", "following", "notes", "reports", "standings", "tables"]
