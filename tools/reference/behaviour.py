"""Behaviour of operations that their shapes do not say, as data."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["differs", "decided"]


@dataclass(frozen=True)
class Behaviour:
    """One fact about operations here, for users who know the service."""

    kind: Kind
    """`differs`: the service was otherwise; `decided`: the service's behaviour was not documented, or it was
    written down in two ways."""

    topic: str
    """Subject of the behaviour, in a few words."""

    operations: tuple[str, ...]
    """The operations it is about; none: all of them."""

    known: str
    """Behaviour of the service, as far as it is known."""

    here: str
    """Behaviour of this project."""


def differs(topic: str, operations: str, *, known: str, here: str) -> Behaviour:
    """Something that the service did otherwise; operations are separated by spaces."""
    return Behaviour("differs", topic, tuple(operations.split()), known, here)


def decided(topic: str, operations: str, *, known: str, here: str) -> Behaviour:
    """Something that had to be decided; operations are separated by spaces."""
    return Behaviour("decided", topic, tuple(operations.split()), known, here)
