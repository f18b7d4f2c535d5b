# pyright: reportUnsupportedDunderAll=false
"""Telling people how a run ended: by webhook, e-mail or chat, through apprise.

May import: `schemas`, `tasks.inspection`, `tasks.service`, `tasks.simulations.planning`,
`tasks.worlds`.
"""

__all__ = ["messages", "notices", "sending"]
