"""Runs in Python: running a specification, and reading the results of runs, in scripts and notebooks.

```
spec.yaml ──> run() ──┐
run id, latest ──> results() ──> Run ──> rows, to_arrow(), to_pandas()
                                  ├──> Job ──> result(), open(name)
                                  └──> World ──> plan, picture
```
"""
