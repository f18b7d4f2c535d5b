"""Looking at what ran: finding runs and their records, running them again, gathering reports.

May import: `schemas`, `tasks.catalog`, `tasks.comparison`, `tasks.execution`, `tasks.jobs`, `tasks.reporting`,
`tasks.results`, `tasks.runtime.agents`, `tasks.runtime.episode`, `tasks.runtime.limits`, `tasks.runtime.replay`,
`tasks.runtime.states`, `tasks.runtime.trials`, `tasks.service`, `tasks.simulations`, `tasks.simulations.containers`,
`tasks.simulations.inputs`, `tasks.simulations.outputs`, `tasks.simulations.planning`, `tasks.simulations.ros`,
`tasks.storage`, `tasks.worlds`.
"""

__all__ = [
    "commits",
    "forecasting",
    "kept_forecasts",
    "pipeline_parts",
    "preflight",
    "probes",
    "replays",
    "reports",
    "reruns",
    "reuse_plans",
    "run_records",
    "standings",
]
