"""The service that every operation works with: settings, catalog, object store, clock, random numbers.

May import: `schemas`, `tasks.backends`, `tasks.catalog`, `tasks.storage`, `tasks.storage.roles`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["builtin_applications", "catalog_wait", "home", "patient_store", "service", "spans"]
