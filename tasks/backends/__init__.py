"""Backends: start job workers on other machines, which take the jobs of a batch from the catalog.

| `ROBOMAKER_BACKEND` | job workers are |
| --- | --- |
| `local` | threads of the process that runs the batch; nothing here is used |
| `by-hand` | started by hand, by SSH for instance |
| `workers:POOL` | flow runs of a Prefect work pool |
| `dask:tcp://HOST:8786` | one for each worker of a Dask cluster |
| `ray:HOST:6379` | one for each node of a Ray cluster |

A job worker is the command `robomaker work BATCH`. It is started once on each machine, not once for each job: to start
a flow run takes seconds, to claim a job milliseconds. A backend knows nothing of jobs, and carries no secrets: each
machine has its own settings, which lead to the same catalog and object store.
"""
