"""Runs of specifications (nights): files kept until a run has ended, so that an interrupted run is found and resumed.

```
run's folder    order.json        all that another process needs; gone when the run has ended
                answers.jsonl     what its steps were answered: nothing is asked for twice
                running.lock      locked for as long as the run's process lives
any process of the home that may run jobs ── TakingUp ── finds folders with an order whose lock is free
```
"""
