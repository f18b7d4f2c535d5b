"""Runs of specifications that visitors of the console order: each is a process of its own, like `robomaker run`.

```
console ── rights (may the key do all this?) ── SpecRuns ── process: `deployments.cli.ordered_run`
                                                   │            each step asks the key's rights again (permits)
   the run's page ── standing.json, running.lock ──┴── the run's folder
```

A run goes on when the page is closed, and when the server ends. Server and run know each other by files in the run's
folder only, so that any server of the data home shows the run and ends it. A run whose process was killed goes on in a
new one, from what is in its folder: the order, and what its steps were answered.
"""
