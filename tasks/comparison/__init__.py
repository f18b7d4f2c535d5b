"""Comparing runs of specifications: pairs of trials, statistics, history; reads records and tables of results.

```
comparison = compare(before, after, alpha=0.05)
print(comparison.answer, comparison.why)
```

`statistics`, `margins` and `difference_test` import scipy, and so do those that import them; the rest is quick.
"""
