"""Fleets and deployments in words: tables, lines of what changes, the block on a terminal.

May import: `schemas`, `tasks`, `deployments.cli.output`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["text", "watching"]
