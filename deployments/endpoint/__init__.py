"""HTTP endpoint with AWS RoboMaker's API: the rest-json protocol with SigV4 signatures.

```
request ── connections (bodies) ── who may (origins, authentication) ── which operation (wire)
        ── members (wire) ── the registry of operations ── answer (wire)
```

Nothing here knows a single operation: paths, members, answers and errors are read from `OPERATIONS`.
"""
