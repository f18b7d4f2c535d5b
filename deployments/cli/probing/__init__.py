"""Probes of specifications for `plan --probe`: cut down, run for real, and what that forecasts.

`machines` is quick to import; `passes` and `forecasts` import Prefect, and come after `use_server`. May import what
`pipelines.py` may.
"""

__all__: list[str] = []
