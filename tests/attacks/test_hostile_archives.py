"""Archives that mean harm: links, devices, bombs, names; each is refused whole, or unpacks inside its folder."""

import gzip
import io
import os
import stat
import struct
import tarfile
import time
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from prefect_robomaker.schemas.wire.errors import BundleError
from prefect_robomaker.tasks.storage import ArchiveLimits, unpack

FILE, LINK, HARD, FOLDER = tarfile.REGTYPE, tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.DIRTYPE
MOST_S = 60.0
"""Limit of processor time; most take milliseconds."""
MOST_ENTRIES = 10_000
"""Files and folders that are allowed here; ten times as many are by default, which takes ten times as long to see."""


def tar(*members: tuple[str, bytes, str], form: int = tarfile.GNU_FORMAT, mode: int = 0o644) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=form) as archive:
        for name, kind, content in members:
            info = tarfile.TarInfo(name)
            info.type, info.mode = kind, mode
            if kind == FILE:
                info.size = len(content)
                archive.addfile(info, io.BytesIO(content.encode()))
            else:
                info.linkname = content
                archive.addfile(info)
    return buffer.getvalue()


def special(kind: bytes) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        info = tarfile.TarInfo("special")
        info.type, info.devmajor, info.devminor = kind, 1, 3
        archive.addfile(info)
    return buffer.getvalue()


def zipped(*members: tuple[str, str], kind: int = stat.S_IFREG, mode: int = 0o644) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members:
            info = zipfile.ZipInfo(name)
            info.external_attr = (kind | mode) << 16
            archive.writestr(info, content, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def bomb(size: int) -> bytes:
    """A tar of one file of zeros, compressed."""
    info = tarfile.TarInfo("zeros")
    info.size = size
    buffer = io.BytesIO()
    with gzip.GzipFile(fileobj=buffer, mode="wb", compresslevel=9) as target:
        target.write(info.tobuf())
        for _ in range(size >> 20):
            target.write(bytes(1 << 20))
        target.write(bytes(10240))
    return buffer.getvalue()


def overlapping() -> bytes:
    """A zip of which many names lead to the same compressed bytes."""
    data = zipped(("a", "x" * 100_000))
    end = data.rindex(b"PK\x05\x06")
    begin = struct.unpack_from("<I", data, end + 16)[0]
    entry = data[begin:end]
    entries = b"".join(entry.replace(b"a", bytes([97 + number]), 1) for number in range(20))
    tail = struct.pack("<4sHHHHIIH", b"PK\x05\x06", 0, 0, 20, 20, len(entries), begin, 0)
    return data[:begin] + entries + tail


def sparse() -> bytes:
    """A GNU tar whose file claims a hole of a terabyte."""
    info = tarfile.TarInfo("sparse")
    info.type = tarfile.GNUTYPE_SPARSE
    block = bytearray(info.tobuf(tarfile.GNU_FORMAT))
    block[386:398] = b"00000000000\0"
    block[398:410] = b"00000000000\0"
    block[483:495] = b"\x80" + (1 << 40).to_bytes(11, "big")
    block[148:156] = b"%06o\0 " % (sum(block[:148]) + 32 * 8 + sum(block[156:512]))
    return bytes(block) + bytes(10240)


def pax(**headers: str) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as archive:
        info = tarfile.TarInfo("plain")
        info.pax_headers = {name.replace("__", "."): value for name, value in headers.items()}
        info.size = 1
        archive.addfile(info, io.BytesIO(b"x"))
    return buffer.getvalue()


ARCHIVES: dict[str, Callable[[], bytes]] = {
    "a link out, and a file through it": lambda: tar(("way", LINK, "../.."), ("way/escaped", FILE, "x")),
    "an absolute link, and a file through it": lambda: tar(("way", LINK, "/tmp"), ("way/escaped", FILE, "x")),
    "a link that a file replaces": lambda: tar(("a", LINK, "../escaped"), ("a", FILE, "x")),
    "a file that a link replaces": lambda: tar(("a", FILE, "x"), ("a", LINK, "../../outside")),
    "a folder that a link replaces": lambda: tar(("a", FOLDER, ""), ("a", LINK, ".."), ("a/escaped", FILE, "x")),
    "a chain of links": lambda: tar(("a", LINK, "."), ("b", LINK, "a/.."), ("b/escaped", FILE, "x")),
    "a hard link to a file outside": lambda: tar(("a", HARD, "../../outside")),
    "a hard link to /etc/passwd": lambda: tar(("a", HARD, "/etc/passwd")),
    "a hard link to a link": lambda: tar(("a", LINK, "/etc/passwd"), ("b", HARD, "a")),
    "a link in a zip": lambda: zipped(("a", "/etc/passwd"), kind=stat.S_IFLNK),
    "a link of the length of a path": lambda: tar(("a", LINK, "../" * 1300 + "etc/passwd")),
    "a character device": lambda: special(tarfile.CHRTYPE),
    "a block device": lambda: special(tarfile.BLKTYPE),
    "a pipe": lambda: special(tarfile.FIFOTYPE),
    "a device in a zip": lambda: zipped(("a", ""), kind=stat.S_IFCHR),
    "a contiguous file": lambda: special(tarfile.CONTTYPE),
    "an unknown kind": lambda: special(b"Z"),
    "set-user-id": lambda: tar(("a", FILE, "x"), mode=0o6755),
    "set-user-id in a zip": lambda: zipped(("a", "x"), mode=0o6777),
    "a way up": lambda: tar(("../escaped", FILE, "x")),
    "a way up in the middle": lambda: tar(("a/../../escaped", FILE, "x")),
    "a way up in a zip": lambda: zipped(("../../escaped", "x")),
    "a way up of Windows": lambda: zipped(("..\\..\\escaped", "x")),
    "an absolute name": lambda: tar(("/tmp/escaped", FILE, "x")),
    "an absolute name in a zip": lambda: zipped(("/tmp/escaped", "x")),
    "a drive": lambda: zipped(("C:\\escaped", "x")),
    "a long name of a header": lambda: pax(path="../escaped"),
    "a long name with NUL": lambda: pax(path="a\0../escaped"),
    "a size of a header": lambda: pax(size="99999999999999"),
    "a negative size of a header": lambda: pax(size="-1"),
    "a link of a header": lambda: pax(linkpath="/etc/passwd"),
    "a sparse file of a header": lambda: pax(
        GNU__sparse__major="1", GNU__sparse__minor="0", GNU__sparse__realsize="1" + "0" * 15
    ),
    "names that differ in case": lambda: tar(("a/B", FILE, "1"), ("A/b", FILE, "2")),
    "names that differ in composition": lambda: tar(("\u00e9", FILE, "1"), ("e\u0301", FILE, "2")),
    "a name of the other direction": lambda: tar(("\u202ecod.exe", FILE, "x")),
    "a thousand folders": lambda: tar(("/".join(["d"] * 1000), FILE, "x")),
    "a name of a kilobyte": lambda: tar(("n" * 1000, FILE, "x")),
    "a bomb of 512 MB": lambda: bomb(512 << 20),  # twice the bytes that every archive may hold
    "a bomb in a bomb": lambda: gzip.compress(bomb(300 << 20)),
    "a zip whose members overlap": overlapping,
    "a sparse file of a terabyte": sparse,
    "twice as many files as allowed": lambda: zipped(*((f"{n:06}", "") for n in range(2 * MOST_ENTRIES))),
    "nothing but a header": lambda: gzip.compress(b""),
    "a zip that is a tar": lambda: tar(("a", FILE, "x")) + zipped(("b", "y")),
}  # fmt: skip


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=pytest.mark.deep) if "bomb" in name or "twice" in name else name for name in ARCHIVES
])  # fmt: skip
@pytest.mark.parametrize("system_tree", [False, True], ids=["bundle", "tree"])
def test_it_is_refused_whole_or_unpacks_inside(name: str, system_tree: bool, tmp_path: Path) -> None:
    (tmp_path / "outside").write_text("s3cret")
    (tmp_path / "in").mkdir()
    archive, folder = tmp_path / "archive", tmp_path / "in" / "folder"
    archive.write_bytes(ARCHIVES[name]())
    before = {Path("/tmp/escaped").exists(), Path("/escaped").exists()}
    began_s = time.process_time()
    with suppress(BundleError):
        unpack(archive, folder, limits=ArchiveLimits(entries=MOST_ENTRIES, is_system_tree=system_tree))
    assert time.process_time() - began_s < MOST_S
    assert [path.name for path in (tmp_path / "in").iterdir()] in ([], ["folder"]), "nothing half is left behind"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["archive", "in", "outside"]
    assert (tmp_path / "outside").read_text() == "s3cret"
    assert {Path("/tmp/escaped").exists(), Path("/escaped").exists()} == before
    for path in folder.rglob("*") if folder.exists() else ():
        about = path.lstat()
        assert stat.S_ISREG(about.st_mode) or stat.S_ISDIR(about.st_mode) or (system_tree and path.is_symlink())
        assert Path(os.path.realpath(path)).is_relative_to(folder.resolve()), "no link leads out"
        assert not about.st_mode & 0o7000
        assert stat.S_ISDIR(about.st_mode) or about.st_nlink <= 2
