"""Files that appear whole or not at all."""

import stat
from contextlib import suppress
from pathlib import Path

from prefect_robomaker.tasks.files.whole_files import replaced, write_whole


def test_an_earlier_file_stays_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = write_whole(tmp_path / "record.json", "first")
    with suppress(RuntimeError), replaced(path) as part:
        part.write_text("half")
        assert path.read_text() == "first"
        raise RuntimeError("half way")
    assert [each.name for each in tmp_path.iterdir()] == ["record.json"]
    assert path.read_text() == "first"


def test_two_writers_at_once_do_not_rename_each_others_half(tmp_path: Path) -> None:
    """With one temporary name for all, the first to end took what the second had begun, and the second found none."""
    path = tmp_path / "record.json"
    with replaced(path) as slow:
        slow.write_text("sl")
        write_whole(path, "quick")
        assert path.read_text() == "quick"
        slow.write_text("slow")
    assert path.read_text() == "slow"


def test_a_name_may_have_all_the_characters_that_a_file_system_takes(tmp_path: Path) -> None:
    assert write_whole(tmp_path / ("n" * 255), b"\xff").read_bytes() == b"\xff"


def test_a_private_file_is_private_from_its_first_byte(tmp_path: Path) -> None:
    path = write_whole(tmp_path / "order.json", "{}")
    path.chmod(0o644)
    write_whole(path, "{}", 0o600, is_synced=True)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
