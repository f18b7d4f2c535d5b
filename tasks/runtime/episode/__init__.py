"""Parts that all rooms of the runtime share: context, phases, verdicts, physics and its health, loading of factories.

May import: `schemas`, `tasks.runtime.recording`.
"""

__all__ = [
    "clearance",
    "contact_forces",
    "context",
    "driven_path",
    "health",
    "loading",
    "physics",
    "program_names",
    "progress",
    "results",
    "resumable",
    "robot_body",
    "stops",
    "verdicts",
]
