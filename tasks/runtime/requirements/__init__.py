"""Requirements: what is measured, the score, and the observer that judges a run.

May import: `schemas`, `tasks.runtime.episode`.
"""

__all__ = ["checks", "observer"]
