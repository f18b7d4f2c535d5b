"""Table of a run's results, with one row per trial, and the success rates computed from it for reports and verdicts.

```
results = ResultTable.read(folder / RESULTS_FILE)
print(rates.of_table("all trials", results).rate)
```
"""
