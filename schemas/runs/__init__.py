"""Runs as data: the plan, programs, variables, requirements, results, provenance, manifest and `robot.yaml`.

May import: `schemas` (exit codes), `schemas.wire`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = [
    "failure_state",
    "machine_waits",
    "manifest",
    "plan",
    "programs",
    "provenance",
    "requested_requirements",
    "requested_trials",
    "requirements",
    "robot_yaml",
    "stops",
    "trial_rows",
    "trials",
    "variables",
    "verification",
]
