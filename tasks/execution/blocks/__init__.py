# pyright: reportUnsupportedDunderAll=false
"""Blocks of Prefect that jobs need while they run: credentials of their roles.

May import: nothing of this package.
"""

__all__ = ["credential_blocks"]
