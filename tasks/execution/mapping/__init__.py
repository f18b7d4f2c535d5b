"""One task run for a whole `map`, for any flow of Prefect.

May import: `schemas.wire`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["items", "runner"]
