"""Requirements: measurements, score, and the observer that checks a run against them.

May import: `schemas`, `tasks.runtime.episode`.
"""

__all__ = ["measurements", "observer"]
