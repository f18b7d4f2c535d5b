# pyright: reportUnsupportedDunderAll=false
"""Telling people how a run ended: by webhook, e-mail or chat, through apprise.

May import: `schemas`, `tasks.comparison`, `tasks.inspection`, `tasks.reporting.nights`, `tasks.service`,
`tasks.simulations.planning`, `tasks.worlds`.
"""

__all__ = ["long_waits", "messages", "notices", "sending"]
