"""Checksums of wholes that were only seen in parts."""

import zlib

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.storage.checksums import crc32_of, crc32_of_parts


@given(st.lists(st.binary(max_size=300), max_size=8))
def test_the_crc32_of_a_whole_follows_from_those_of_its_parts(parts: list[bytes]) -> None:
    assert crc32_of_parts((zlib.crc32(part), len(part)) for part in parts) == crc32_of(b"".join(parts))


def test_parts_may_be_large() -> None:
    part, last = bytes(range(256)) * 4096 * 8, b"the end"
    parts = [(zlib.crc32(part), len(part))] * 3 + [(zlib.crc32(last), len(last))]
    assert crc32_of_parts(parts) == crc32_of(part * 3 + last)
