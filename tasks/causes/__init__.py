"""Causes of failures: failing trials in groups, and the worlds, axes and pairs of axes that each group goes with.

```
why = explain(ResultTable.read(folder / RESULTS_FILE))
print(why.groups[0].in_words)
```

Only functions that compute intervals and tests import scipy, so that reading a report does not wait for it.
"""
