"""Ids of resources, such as `sim-g0959w53813w` and `generation-82856b0yq33y`."""

import random
import string
from typing import Literal

IdPrefix = Literal["sim", "batch", "template", "generation", "export", "deployment", "import", "variation"]

_ALPHABET = string.digits + string.ascii_lowercase
_LENGTH = 12


def new_id(prefix: IdPrefix, source: random.Random) -> str:
    """Makes an id: the prefix, a hyphen, twelve digits and small letters.

    Args:
        prefix: what it is an id of.
        source: where the randomness comes from; `random.SystemRandom()` where ids have to differ
            between processes.
    """
    return f"{prefix}-{''.join(source.choices(_ALPHABET, k=_LENGTH))}"


def world_id(generation_id: str, number: int) -> str:
    """The id of the world of that number, counted from 1, of a generation job: `generation-…/world-3`.

    Raises:
        ValueError: the number is below 1.
    """
    if number < 1:
        raise ValueError(f"world number is {number}; worlds are counted from 1")
    return f"{generation_id}/world-{number}"
