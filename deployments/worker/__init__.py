"""Job worker of the endpoint: a separate process that runs stored jobs, so that neither slows the other down.

```
robomaker serve                     this package
  endpoint ── WorkerProcess ═════ process: WarmWorker      runs each job as a flow run in a thread
              starts, wakes,      pipe
              watches, stops it
```

The catalog holds the jobs, and both processes read it. The pipe between them carries only "look now", "stop" and
the worker's status. When it closes, the other side has died.
"""
