"""Kinds of backends (where jobs run) by name, as the setting `ROBOMAKER_BACKEND` and its help list them."""

from .discovery import named
from .wire.errors import ConfigurationError

_OWN = {"workers": "POOL", "dask": "ADDRESS", "ray": "ADDRESS"}
_WITHOUT_PLACE = ("local", "by-hand")
_NAMED = named("backends")
for _name, _module in _NAMED.items():
    if _name in _OWN or _name in _WITHOUT_PLACE:
        raise ConfigurationError(
            f"{_module}, which an installed distribution names in prefect_robomaker.backends, takes the name {_name!r} "
            "of a backend of this package; its entry point needs another name"
        )

BACKENDS = {**dict.fromkeys(_NAMED, "PLACE"), **_OWN}
"""Backend kinds that need a place (such as a work pool), each with the word for the place in help texts. Backends of
other distributions are named by their entry points.
"""
*_SOME, _LAST = (*_WITHOUT_PLACE, *(f"{kind}:{place}" for kind, place in BACKENDS.items()))
BACKENDS_IN_WORDS = f"{', '.join(_SOME)} or {_LAST}"
