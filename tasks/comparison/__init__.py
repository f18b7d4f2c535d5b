"""Comparing runs of specifications: pairs of trials, statistics, history; reads records and tables of results.

```
comparison = compare(before, after, alpha=0.05)
print(comparison.answer, comparison.why)
```

Only `statistics` imports scipy, for `difference_test`, which only `better_or_worse` imports; the rest is quick.
"""
