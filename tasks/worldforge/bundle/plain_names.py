"""Names of a model as programs take them that know letters, digits and `_` only."""

import re
from collections.abc import Mapping
from itertools import chain, count
from typing import NamedTuple

NAMES_FILE = "names.json"

_PLAIN = re.compile(r"[A-Za-z0-9_]+")
_NAMED = re.compile(r'\sname="([^"]+)"')
_ATTRIBUTE = re.compile(r'(\s(\w+)=")([^"]*)(?=")')


class PlainModel(NamedTuple):
    """A model with plain names."""

    mjcf: str
    names: Mapping[str, str]
    """Names in `world.json` and the other files, by plain name; only those that differ."""


def with_plain_names(mjcf: str) -> PlainModel:
    """Writes `_` for what else there is in names, wherever they are named; two never become one.

    Args:
        mjcf: the text of a model.
    """
    names = dict.fromkeys(_NAMED.findall(mjcf))
    plain = {name: name for name in names if _PLAIN.fullmatch(name)}
    taken = set(plain)
    for name in names:
        if name not in plain:
            short = re.sub(r"[^A-Za-z0-9_]", "_", name)
            numbered = (f"{short}_{number}" for number in count(2))
            plain[name] = next(each for each in chain([short], numbered) if each not in taken)
            taken.add(plain[name])
    text = _ATTRIBUTE.sub(lambda at: at[1] + (at[3] if at[2] == "file" else plain.get(at[3], at[3])), mjcf)
    return PlainModel(text, {new: name for name, new in plain.items() if new != name})
