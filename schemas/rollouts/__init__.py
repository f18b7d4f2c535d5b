# pyright: reportUnsupportedDunderAll=false
"""Rollouts as data: the plan of a deployment to a fleet, how each robot stands, and what can happen.

A rollout is stored as one JSON document. Times are seconds since the epoch.

May import: `schemas.operations` (statuses and codes of deployments), `schemas.wire`.
"""

__all__ = ["artifacts", "events", "plan", "report", "robots", "rollout", "standings", "stored"]
