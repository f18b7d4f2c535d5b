"""The page of a deployment: what each robot did when, wave by wave, and how it ended.

May import: `schemas`, `tasks.reporting`, `tasks.reporting.drawings`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["view"]
