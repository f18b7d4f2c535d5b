# pyright: reportUnsupportedDunderAll=false
"""Update repository that robots' agents trust: The Update Framework (TUF), as plain files in the object store.

```
   keys ───────────────────┐
   (data home)             v
   what is there ──> what comes next (metadata, pure) ──> files ──> the numbered timestamp: from here on it is visible
   (verified)                                             (each number is written once, by one publisher)
```

May import: `schemas`, `tasks.catalog`, `tasks.fleet`, `tasks.service`, `tasks.storage`.
"""

__all__ = [
    "ceremonies",
    "collecting",
    "deployments",
    "enrolment",
    "publishing",
    "roots",
    "serving",
    "standing",
]
