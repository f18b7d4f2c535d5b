"""Update repository that robots' agents trust: The Update Framework (TUF), as plain files in the object store.

```
   keys ───────────────────┐
   (data home)             v
   what is there ──> what comes next (metadata, pure) ──> files ──> the numbered timestamp: from here on it is visible
   (verified)                                             (each number is written once, by one publisher)
```
"""
