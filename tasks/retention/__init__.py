# pyright: reportUnsupportedDunderAll=false
"""Removing what is not needed any more: old runs, their outputs and jobs, and worlds that nothing names.

May import: `schemas`, `tasks.catalog`, `tasks.inspection`, `tasks.runtime.agents`, `tasks.runtime.episode`,
`tasks.runtime.states`, `tasks.runtime.video`, `tasks.service`, `tasks.simulations.containers`,
`tasks.simulations.environment`, `tasks.simulations.outputs`, `tasks.storage`, `tasks.worlds`.
"""

__all__ = ["collection", "policy"]
