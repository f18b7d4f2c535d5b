"""Stored results of a job's trials: the journal, the tally, the table.

May import: `schemas`, `tasks.results`, `tasks.runtime.episode`, `tasks.runtime.limits`.
"""

__all__ = ["completion", "journal", "table", "tally"]
