"""Walking real folders that were made to be hard to walk, as a user who is not root."""

import gc
import json
import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from prefect_robomaker.tasks.files.untrusted_files import deleted_files, files_below

MB = 10**6
NOBODY = 65534
SIZES_BELOW = """
import json, os, sys
from pathlib import Path
from prefect_robomaker.tasks.files.untrusted_files import files_below
if os.geteuid() == 0:
    os.setgroups([]); os.setgid({user}); os.setuid({user})
{code}
print(json.dumps([file.size_bytes for file in files_below([Path(sys.argv[1])]) if file]))
"""


def sizes_below(folder: Path, code: str) -> list[int]:
    """What another user, who is no root, sees in a folder of theirs after they have done something there."""
    folder.mkdir(exist_ok=True)
    if os.geteuid() == 0:
        os.chown(folder, NOBODY, NOBODY)
        for parent in folder.parents:
            if parent.owner() == "root" and not parent.stat().st_mode & stat.S_IXOTH:
                parent.chmod(parent.stat().st_mode | stat.S_IXOTH)
    code = f"folder = Path(sys.argv[1])\n{code}"
    argv = [sys.executable, "-c", SIZES_BELOW.format(user=NOBODY, code=code), str(folder)]
    return json.loads(subprocess.run(argv, capture_output=True, text=True, check=True).stdout)


@pytest.mark.parametrize("mode", [0o000, 0o300, 0o400, 0o600, 0o100])
def test_folders_that_may_not_be_read_or_passed_are_looked_into(tmp_path: Path, mode: int) -> None:
    """Also those in which there is but another folder."""
    code = f"""
(folder / "a/b").mkdir(parents=True)
(folder / "a/b/x").write_bytes(bytes(1_000_000))
for each in (folder / "a/b", folder / "a"):
    each.chmod({mode})
"""
    [size] = sizes_below(tmp_path / "theirs", code)
    assert size == pytest.approx(MB, rel=0.01)


def test_what_is_somebody_elses_is_left_alone(tmp_path: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root can make files of others")
    folder = tmp_path / "theirs"

    def lock() -> int:
        (folder / "mine").mkdir(exist_ok=True)
        (folder / "mine").chmod(0)
        return stat.S_IMODE((folder / "mine").stat().st_mode)

    assert sizes_below(folder, "") == []
    assert lock() == 0
    assert sizes_below(folder, "(folder / 'x').touch()") == [4096]
    assert stat.S_IMODE((folder / "mine").stat().st_mode) == 0


def test_no_folder_is_too_deep(tmp_path: Path) -> None:
    """Its path would be ten thousand bytes long."""
    here = os.open(tmp_path, os.O_RDONLY)
    for _ in range(50):
        os.mkdir("d" * 200, dir_fd=here)
        inner = os.open("d" * 200, os.O_RDONLY, dir_fd=here)
        os.close(here)
        here = inner
    descriptor = os.open("x", os.O_CREAT | os.O_WRONLY, dir_fd=here)
    os.write(descriptor, bytes(MB))
    os.close(descriptor)
    os.close(here)

    [file] = [file for file in files_below([tmp_path]) if file]

    assert file.size_bytes == pytest.approx(MB, rel=0.01)
    assert len(file.path) > 10_000
    subprocess.run(["rm", "-rf", str(tmp_path / ("d" * 200))], check=True)


def test_links_lead_nowhere_and_nothing_is_left_open(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    (tmp_path / "far/x").write_bytes(bytes(10))
    (tmp_path / "near").mkdir()
    (tmp_path / "near/link").symlink_to(tmp_path / "far")
    gc.collect()  # what earlier tests left is closed now, and not meanwhile
    open_before = len(list(Path("/proc/self/fd").iterdir()))

    [link] = [file for file in files_below([tmp_path / "near", tmp_path / "gone"]) if file]
    next(walk := files_below([tmp_path]))
    del walk

    assert link.path == str(tmp_path / "near/link")
    assert len(list(Path("/proc/self/fd").iterdir())) == open_before


@contextmanager
def deleted(path: Path, size: int) -> Iterator[int]:
    """A file that is open twice and has no name; its device."""
    with path.open("wb") as file, path.open("rb"):
        file.write(bytes(size))
        file.flush()
        path.unlink()
        yield os.fstat(file.fileno()).st_dev


def test_deleted_files_count_once_while_they_are_open(tmp_path: Path) -> None:
    with deleted(tmp_path / "x", MB) as device:
        memory = os.memfd_create("memory")
        os.posix_fallocate(memory, 0, MB)
        sizes = [size for size in deleted_files([os.getpid(), 2**22 + 1], {device}) if size]
        os.close(memory)
    # This process may have other files of that kind.
    assert [size for size in sizes if size >= MB] == [pytest.approx(MB, rel=0.01)]
    assert not [size for size in deleted_files([os.getpid()], {device}) if size and size >= MB]
