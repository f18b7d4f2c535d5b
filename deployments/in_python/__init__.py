"""Python API for runs: running a specification and reading results, in scripts and notebooks.

```
spec.yaml ──> run() ──┐
run id, latest ──> results() ──> Run ──> rows, to_arrow(), to_pandas()
                                  ├──> Job ──> result(), open(name)
                                  └──> World ──> plan, picture
```
"""
