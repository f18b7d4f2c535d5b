"""State machine of deployment jobs."""

from ..state_machines import Lifecycle, transition_table
from ..wire.base import choices
from .operations.deployment_jobs import DeploymentStatus

_DEPLOYMENT_ROWS: dict[str, tuple[tuple[DeploymentStatus, ...], DeploymentStatus]] = {
    "prepare": (("Pending",), "Preparing"),
    "start": (("Preparing",), "InProgress"),
    "succeed": (("InProgress",), "Succeeded"),
    "fail": (("Pending", "Preparing", "InProgress"), "Failed"),
    "cancel": (("Pending", "Preparing", "InProgress"), "Canceled"),
}

DEPLOYMENT_JOB: Lifecycle[DeploymentStatus] = Lifecycle(
    name="the deployment job",
    initial="Pending",
    states=choices(DeploymentStatus),
    terminal=frozenset({"Succeeded", "Failed", "Canceled"}),
    transitions=transition_table(_DEPLOYMENT_ROWS),
)
"""State machine of a deployment job.

```
          prepare            start             succeed
  Pending ───────> Preparing ─────> InProgress ───────> Succeeded
     ├─────────────────┼────────────────┼───── fail ──> Failed
     └─────────────────┴────────────────┴── cancel ───> Canceled
```

`prepare`: the files that robots download are made. `start`: robots get their orders, wave by wave. `succeed`: each
robot has finished, and fewer failed than the threshold. `fail` comes with a failure code. Neither `fail` nor `cancel`
waits for robots: one that has begun may still report, which changes its own status only.
"""

LIFECYCLES = {"deployment-job": DEPLOYMENT_JOB}
"""State machine of each kind of resource of fleets that has one."""
