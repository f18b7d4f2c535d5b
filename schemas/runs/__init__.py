"""Runs as data: the plan, programs, variables, requirements, results, provenance, manifest and `robot.yaml`.

May import: `schemas` (exit codes), `schemas.wire`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = [
    "failure_state",
    "manifest",
    "plan",
    "programs",
    "provenance",
    "requested_requirements",
    "requirements",
    "robot_yaml",
    "stops",
    "variables",
    "verification",
]
