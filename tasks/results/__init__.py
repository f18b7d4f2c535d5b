"""The table of results: one row a trial of a run, and the rates that everything that shows or judges runs reads of it.

```
results = ResultTable.read(folder / RESULTS_FILE)
print(rates.of_table("all trials", results).rate)
```
"""
