"""The rollout of a deployment to a fleet, as a state machine: events in, orders and cancellations out.

```
rollout = begin(plan, now_s)
ledger = Ledger(rollout)                    # the same, indexed: for many events in a row
ledger.apply(Succeeded(robot=arn, action_id=8), now_s)
for robot in ledger.offers():           # the caller numbers the orders
    ledger.apply(Offered(robot=robot, action_id=next_id()), now_s)
rollout = ledger.rollout()                  # to be stored
```

There are no clocks, stores or robots in here: time comes in as an argument, in seconds since the epoch.
"""
