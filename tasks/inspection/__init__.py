"""Looking at what ran: finding runs, running them again, gathering reports.

May import: `schemas`, `tasks.catalog`, `tasks.execution`, `tasks.reporting`, `tasks.runtime.agents`,
`tasks.runtime.episode`, `tasks.runtime.limits`, `tasks.runtime.replay`, `tasks.runtime.states`, `tasks.service`,
`tasks.simulations`, `tasks.simulations.containers`, `tasks.simulations.inputs`, `tasks.simulations.planning`,
`tasks.simulations.ros`, `tasks.storage`.
"""

__all__ = ["replays", "reports"]
