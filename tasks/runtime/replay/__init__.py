"""Running a stored run again, and comparing the two.

May import: `schemas`, `tasks.runtime.agents`, `tasks.runtime.episode`, `tasks.runtime.states`,
`tasks.runtime.supervision`.
"""

__all__ = ["divergence", "replay", "repro"]
