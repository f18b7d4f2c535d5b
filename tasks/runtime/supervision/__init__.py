"""Starting runs and watching them: launcher, fork server, supervisor, programs, ports, attribution of crashes.

May import: `schemas`, `tasks.runtime.agents`, `tasks.runtime.episode`, `tasks.runtime.limits`,
`tasks.runtime.process`, `tasks.runtime.rendering`, `tasks.runtime.sandbox`, `tasks.runtime.states`,
`tasks.runtime.trials`, `tasks.runtime.video`.
"""

__all__ = ["boxes", "finished_outputs", "launcher"]
