"""What carries out the jobs that the endpoint takes: a process beside it, so that neither slows the other down.

```
robomaker serve                     this package
  endpoint ── WorkerProcess ═════ process: WarmWorker    runs each job as a flow run in a thread
              starts, wakes,       pipe     or Dispatcher    hands each job to a Prefect deployment
              watches, stops it
```

What is to be done stands in the catalog, where both find it; the pipe between them only says "look now",
"stop", and how things are. When it closes, the other side is dead.
"""
