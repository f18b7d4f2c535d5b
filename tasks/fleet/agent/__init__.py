"""Robot agent: installs application versions that the fleet's TUF repository has signed, and rolls back failed ones.

```
server (DDI) ──> loop ──> states: state, event -> state ──> journal, on disk before anything is done
                  ^                                             │
                  └── events ── effects: child (TUF, download, unpack), scripts, the application
```

This folder is also the package `robomaker_agent` of the wheel `robomaker-agent`: it imports nothing outside itself but
the standard library, `tuf` and `securesystemslib`, and runs on Python 3.9.
"""
