"""Files in folders of untrusted programs are written whole or not at all."""

from io import BytesIO
from pathlib import Path
from typing import cast

import pytest

from prefect_robomaker.tasks.files.untrusted_files import unfinished_of, write_all, write_anew


def test_a_link_that_a_program_left_is_not_followed(tmp_path: Path) -> None:
    path, precious = tmp_path / "result.json", tmp_path / "precious"
    precious.write_bytes(b"precious")
    unfinished_of(path).symlink_to(precious)

    write_anew(path, b"whole ", b"file")

    assert (path.read_bytes(), path.is_symlink(), precious.read_bytes()) == (b"whole file", False, b"precious")
    assert set(tmp_path.iterdir()) == {path, precious}


def test_a_file_that_breaks_off_leaves_the_earlier_one(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    write_anew(path, b"earlier")

    with pytest.raises(TypeError):
        write_anew(path, b"half", cast("bytes", "no bytes"))

    assert path.read_bytes() == b"earlier"
    write_anew(path, b"later")
    assert path.read_bytes() == b"later"


def test_partial_writes_are_repeated() -> None:
    class Slow(BytesIO):
        def write(self, data: memoryview) -> int:  # pyright: ignore[reportIncompatibleMethodOverride]
            return super().write(data[:3])

    write_all(file := Slow(), b"0123456789")

    assert file.getvalue() == b"0123456789"
