"""The process of a run: from a fork to `result.json`, with its loop and its observers.

May import: `schemas`, `tasks.runtime.agents`, `tasks.runtime.applications.indoor_navigation`,
`tasks.runtime.applications.scout`, `tasks.runtime.episode`, `tasks.runtime.limits`, `tasks.runtime.recording`,
`tasks.runtime.rendering`, `tasks.runtime.requirements`, `tasks.runtime.sandbox`, `tasks.runtime.states`,
`tasks.runtime.trials`, `tasks.runtime.video`.
"""

__all__ = ["child", "rehearsal", "run_request", "run_sights", "waiting_run"]
