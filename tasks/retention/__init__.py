# pyright: reportUnsupportedDunderAll=false
"""Removing what is not needed: old runs, their outputs and jobs, worlds that nothing names, files for robots, copies.

May import: `schemas`, `tasks.catalog`, `tasks.fleet.trust`, `tasks.inspection`, `tasks.runtime.agents`,
`tasks.runtime.episode`, `tasks.runtime.states`, `tasks.runtime.video`, `tasks.service`, `tasks.simulations.containers`,
`tasks.simulations.environment`, `tasks.simulations.inputs`, `tasks.simulations.outputs`, `tasks.storage`,
`tasks.worlds`.
"""

__all__ = ["collection", "policy"]
