"""Kinds of backends by name, as the setting `ROBOMAKER_BACKEND` and its help list them."""

from .discovery import named

BACKENDS = {**dict.fromkeys(named("backends"), "PLACE"), "workers": "POOL", "dask": "ADDRESS", "ray": "ADDRESS"}
"""Backends that need a place, and a word for it. Those of distributions are named by their entry points."""
*_SOME, _LAST = ("local", "by-hand", *(f"{kind}:{place}" for kind, place in BACKENDS.items()))
BACKENDS_IN_WORDS = f"{', '.join(_SOME)} or {_LAST}"
