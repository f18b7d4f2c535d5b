"""Comparing runs of specifications: pairs of jobs, statistics, history; pure functions of runs' records.

```
comparison = compare(before, after, alpha=0.05)
print(comparison.answer, comparison.why)
```

Only `statistics` imports scipy, and only `comparison_answer` imports `statistics`; the rest is quick to import.

May import: `schemas`, `tasks.reporting`.
"""

__all__ = ["comparison_answer", "history", "nights"]
