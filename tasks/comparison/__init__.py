"""Comparing runs of specifications: pairs of jobs, statistics, history; pure functions of runs' records.

```
comparison = compare(before, after, alpha=0.05)
print(comparison.answer, comparison.why)
```

Only `statistics` imports scipy, and only `better_or_worse` imports `statistics`; the rest is quick to import.

May import: `schemas`, `tasks.reporting`.
"""

__all__ = ["better_or_worse", "history", "nights", "pairing"]
