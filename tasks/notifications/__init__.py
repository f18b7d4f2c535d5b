# pyright: reportUnsupportedDunderAll=false
"""Telling people how a run ended: by webhook, e-mail or chat, through apprise.

May import: `schemas`, `tasks.catalog`, `tasks.service`, `tasks.storage`.
"""

__all__ = ["messages", "notices", "sending"]
