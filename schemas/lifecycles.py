"""State machines of jobs and batches: states, events, legal transitions, and how a batch ends.

A status only changes by these tables.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from .operations.simulation_job_batches import SimulationJobBatchStatus
from .operations.simulation_jobs import SimulationJobStatus
from .operations.world_export_jobs import WorldExportJobStatus
from .operations.world_generation_jobs import WorldGenerationJobStatus
from .state_machines import Lifecycle, transition_table
from .wings import parts_of_wings
from .wire.base import choices

_JOB_ROWS: dict[str, tuple[tuple[SimulationJobStatus, ...], SimulationJobStatus]] = {
    "start": (("Preparing", "Restarting"), "Running"),
    "crash": (("Running",), "RunningFailed"),
    "restart": (("Running", "RunningFailed"), "Restarting"),
    "finish": (("Running", "RunningFailed"), "Terminating"),
    "terminate": (("Pending", "Preparing", "Running", "Restarting", "RunningFailed"), "Terminating"),
    "complete": (("Terminating",), "Completed"),
    "fail": (("Pending", "Preparing", "Restarting", "Terminating"), "Failed"),
    "cancel": (("Terminating",), "Canceled"),
}
_PREPARE_ROWS: dict[tuple[SimulationJobStatus, str], SimulationJobStatus] = {
    ("Pending", "prepare"): "Preparing",
    ("Preparing", "prepare"): "Preparing",
    ("Running", "prepare"): "Restarting",
    ("RunningFailed", "prepare"): "Restarting",
    ("Restarting", "prepare"): "Restarting",
    ("Terminating", "prepare"): "Restarting",
}

SIMULATION_JOB: Lifecycle[SimulationJobStatus] = Lifecycle(
    name="the simulation job",
    initial="Pending",
    states=choices(SimulationJobStatus),
    terminal=frozenset({"Completed", "Failed", "Terminated", "Canceled"}),
    transitions={**transition_table(_JOB_ROWS), **_PREPARE_ROWS},
    not_when_canceled=frozenset({"complete"}),
)
"""One simulation job.

```
          prepare            start            finish                complete
  Pending ───────> Preparing ─────> Running ──────────> Terminating ────────> Completed
     │                 │    restart │ ^ │ crash          ^  │  └─── cancel ──> Canceled
     │                 │            v │ v         finish │  │
     │                 │    Restarting  RunningFailed ───┘  │ fail
     └────── fail ─────┴── fail ┘                           └───────────────> Failed
```

`finish` is the end that a run comes to by itself; `terminate` stops a job, and is possible in every
state on the way. Both open the phase of uploads; a job that will fail carries its failure code from
then on, and one that is cancelled meanwhile cannot `complete` any more, so no accepted cancellation is
lost. `restart` is requested by a client while the run goes on: one that ends at the same moment
cannot `finish` any more and is run again, so no accepted restart is lost. `crash` is for
`failureBehavior: Continue`; with `Fail` the job terminates. `prepare` may happen again, for a restart
or after its job worker died, when its outputs died with it even after its run; a job that has run before
is `Restarting` meanwhile. `Terminated` is in the interface, but nothing published says what it meant; no
event leads there.
"""

_BATCH_ROWS: dict[str, tuple[tuple[SimulationJobBatchStatus, ...], SimulationJobBatchStatus]] = {
    "start": (("Pending",), "InProgress"),
    "drain": (("InProgress",), "Completing"),
    "complete": (("InProgress", "Completing"), "Completed"),
    "fail": (("Pending", "InProgress", "Completing", "TimingOut"), "Failed"),
    "time_out": (("Pending", "InProgress", "Completing"), "TimingOut"),
    "timed_out": (("TimingOut",), "TimedOut"),
    "cancel": (("Pending", "InProgress", "Completing"), "Canceling"),
    "canceled": (("Canceling",), "Canceled"),
}

SIMULATION_JOB_BATCH: Lifecycle[SimulationJobBatchStatus] = Lifecycle(
    name="the simulation job batch",
    initial="Pending",
    states=choices(SimulationJobBatchStatus),
    terminal=frozenset({"Completed", "Failed", "TimedOut", "Canceled"}),
    transitions=transition_table(_BATCH_ROWS),
)
"""One batch.

```
          start               drain             complete (also from InProgress)
  Pending ─────> InProgress ───────> Completing ─────────> Completed
     └──────────────┴──────┬────────────┴────── fail ────> Failed
                           │                                  ^
                           ├─ time_out ─> TimingOut ── fail ──┘
                           │                  └──── timed_out ─> TimedOut
                           └─ cancel ───> Canceling ─ canceled ─> Canceled
```

`drain`: no request waits any more, jobs are still active. `fail`, `time_out` and `cancel` are
possible from the beginning.
"""

_GENERATION_ROWS: dict[str, tuple[tuple[WorldGenerationJobStatus, ...], WorldGenerationJobStatus]] = {
    "start": (("Pending",), "Running"),
    "complete": (("Running",), "Completed"),
    "partially_fail": (("Running",), "PartialFailed"),
    "fail": (("Pending", "Running"), "Failed"),
    "cancel": (("Pending", "Running"), "Canceling"),
    "canceled": (("Canceling",), "Canceled"),
}

WORLD_GENERATION_JOB: Lifecycle[WorldGenerationJobStatus] = Lifecycle(
    name="the world generation job",
    initial="Pending",
    states=choices(WorldGenerationJobStatus),
    terminal=frozenset({"Completed", "PartialFailed", "Failed", "Canceled"}),
    transitions=transition_table(_GENERATION_ROWS),
)
"""One world generation job.

```
          start           complete
  Pending ─────> Running ──────────────────> Completed
     │              ├───── partially_fail ─> PartialFailed
     ├──────────────┼───── fail ───────────> Failed
     └── cancel ────┴─> Canceling ─ canceled ─> Canceled
```
"""

_EXPORT_ROWS: dict[str, tuple[tuple[WorldExportJobStatus, ...], WorldExportJobStatus]] = {
    "start": (("Pending",), "Running"),
    "complete": (("Running",), "Completed"),
    "fail": (("Pending", "Running"), "Failed"),
    "cancel": (("Pending", "Running"), "Canceling"),
    "canceled": (("Canceling",), "Canceled"),
}

WORLD_EXPORT_JOB: Lifecycle[WorldExportJobStatus] = Lifecycle(
    name="the world export job",
    initial="Pending",
    states=choices(WorldExportJobStatus),
    terminal=frozenset({"Completed", "Failed", "Canceled"}),
    transitions=transition_table(_EXPORT_ROWS),
)
"""One world export job.

```
          start           complete
  Pending ─────> Running ──────────────────> Completed
     ├──────────────┼───── fail ───────────> Failed
     └── cancel ────┴─> Canceling ─ canceled ─> Canceled
```
"""

LIFECYCLES: Mapping[str, Lifecycle[Any]] = {
    "simulation-job": SIMULATION_JOB,
    "simulation-job-batch": SIMULATION_JOB_BATCH,
    "world-generation-job": WORLD_GENERATION_JOB,
    "world-export-job": WORLD_EXPORT_JOB,
    **{kind: machine for part in parts_of_wings("schemas", "lifecycles") for kind, machine in part.LIFECYCLES.items()},
}
"""State machine of each kind of resource that has one, including those of extensions (wings)."""

ACTIVE: frozenset[SimulationJobStatus] = frozenset(set(SIMULATION_JOB.states) - SIMULATION_JOB.terminal)
"""States in which a simulation job counts towards its batch's `maxConcurrency`."""


def is_terminal(kind: str, status: str) -> bool:
    """Returns whether a resource of a kind with a status has reached its final state; false for kinds without one."""
    return kind in LIFECYCLES and status in LIFECYCLES[kind].terminal


def batch_outcome(
    pending: int,
    failed: Sequence[str],
    created: Sequence[str],
    *,
    timed_out: bool = False,
    canceled: bool = False,
) -> SimulationJobBatchStatus:
    """Determines the status of a simulation job batch from its requests and jobs.

    Jobs that failed, and requests that failed for any reason other than an internal fault, still
    make a completed batch.

    Args:
        pending: Number of requests that wait.
        failed: Failure code of each request that will never become a job.
        created: Status of each created job.
        timed_out: Whether the batch has reached its time limit.
        canceled: Whether the batch was cancelled.
    """
    active = any(status in ACTIVE for status in created)
    internal_fault = "InternalServiceError" in failed
    if canceled:
        return "Canceling" if active else "Canceled"
    if timed_out:
        return "TimingOut" if active else "Failed" if internal_fault else "TimedOut"
    if pending:
        return "InProgress" if created or failed else "Pending"
    if active:
        return "Completing"
    return "Failed" if internal_fault else "Completed"
