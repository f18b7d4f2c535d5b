"""Decodes CDR with `mcap-ros2-support`, which shares no code with the encoder, and compares the members."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory


def assert_decodes_to(data: bytes, ros_type: str, definition: str, expected: Any) -> None:
    """The bytes, read by the definition that lies beside them in a recording, have the members of the message."""
    assert_same(_decoder(ros_type, definition)(data), expected)


@lru_cache
def _decoder(ros_type: str, definition: str) -> Callable[[bytes], Any]:
    schema = Schema(id=1, data=definition.encode(), encoding="ros2msg", name=ros_type)
    decoder = DecoderFactory().decoder_for("cdr", schema)
    assert decoder is not None
    return decoder


def assert_same(found: Any, expected: Any) -> None:
    if isinstance(expected, list | tuple | np.ndarray):
        assert len(found) == len(expected)
        for pair in zip(found, expected, strict=True):
            assert_same(*pair)
    elif names := getattr(found, "__slots__", None):
        for name in names:
            assert_same(getattr(found, name), getattr(expected, name))
    else:
        assert found == expected
