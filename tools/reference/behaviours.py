"""All that is to be known of operations besides their shapes, from `behaviours.yaml`: differences and decisions.

Beside `differences`, which tests compare with the published model, this is what tests of the flows show;
the documentation is made from both.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Literal

from ruamel.yaml import YAML

from prefect_robomaker.schemas.operations.registry import OPERATIONS

Kind = Literal["differs", "decided"]


@dataclass(frozen=True)
class Behaviour:
    """One fact about operations here, for users who know the service."""

    kind: Kind
    """`differs`: the service was otherwise; `decided`: the service's behaviour was not documented, or it was
    written down in two ways."""

    topic: str
    """Subject of the behaviour, in a few words."""

    operations: frozenset[str]
    """The operations it is about; none: all of them."""

    known: str
    """Behaviour of the service, as far as it is known."""

    here: str
    """Behaviour of this project."""


def _behaviour(entry: Mapping[str, str]) -> Behaviour:
    kind: Kind = "differs" if "differs" in entry else "decided"
    about = frozenset(name for word in entry.get("of", "").split() for name in _known(word))
    return Behaviour(kind, entry[kind], about, entry["known"], entry["here"])


def _known(word: str) -> list[str]:
    """The operations that a word names, such as `Create*Application`."""
    if not (found := [name for name in OPERATIONS if fnmatchcase(name, word)]):
        raise ValueError(f"behaviours.yaml: {word!r} is no operation")
    return found


BEHAVIOURS: Mapping[str, tuple[Behaviour, ...]] = {
    subject: tuple(map(_behaviour, entries))
    for subject, entries in YAML(typ="safe").load(Path(__file__).with_suffix(".yaml")).items()
}
"""Behaviours by their subjects."""


def behaviours_of(operation: str) -> tuple[Behaviour, ...]:
    """Lists the known behaviours of one operation, without those that hold for all operations."""
    return tuple(each for group in BEHAVIOURS.values() for each in group if operation in each.operations)
