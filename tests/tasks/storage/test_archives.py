"""Archives are unpacked whole, within limits and inside their folder, or not at all."""

import gzip
import io
import os
import shutil
import stat
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import pytest
from helpers.examples import examples
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.errors import BundleError, StorageError, StorageFullError
from prefect_robomaker.tasks.storage import ArchiveLimits, pack_tar_gz, unpack

CONTENT = {"package/launch/arena.py": b"print('hi')\n", "package/run.sh": b"#!/bin/sh\n", "empty": b"", "ünï": b"x"}
CONTAINERS = ["tar", "tar.gz", "zip"]


def make_tar(
    members: dict[str, bytes], *, mode: Literal["w", "w:gz", "w:bz2", "w:xz"] = "w", **attributes: object
) -> bytes:
    """A tar archive; `attributes` are set on every member."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode=mode) as archive:
        for name, content in members.items():
            info = tarfile.TarInfo(name)
            info.size, info.mode = len(content), 0o755 if name.endswith(".sh") else 0o644
            if name.endswith("/"):
                info.type = tarfile.DIRTYPE
            for attribute, value in attributes.items():
                setattr(info, attribute, value)
            archive.addfile(info, io.BytesIO(content))
    return buffer.getvalue()


def make_zip(members: dict[str, bytes], *, kind: int = stat.S_IFREG) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            info = zipfile.ZipInfo(name)
            info.external_attr = (kind | (0o755 if name.endswith(".sh") else 0o644)) << 16
            if name.endswith("/"):
                info.external_attr = (stat.S_IFDIR | 0o755) << 16
            archive.writestr(info, content, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def make(container: str, members: dict[str, bytes]) -> bytes:
    if container == "zip":
        return make_zip(members)
    return make_tar(members, mode="w" if container == "tar" else "w:gz")


@pytest.fixture
def try_to_unpack(tmp_path: Path) -> Callable[..., dict[str, bytes]]:
    """Unpacks bytes; returns what is there then, and checks that a failure leaves nothing."""
    (tmp_path / "in").mkdir()

    def attempt(data: bytes, **limits: int) -> dict[str, bytes]:
        archive, folder = tmp_path / "archive", tmp_path / "in" / "folder"
        shutil.rmtree(folder, ignore_errors=True)
        archive.write_bytes(data)
        try:
            unpack(archive, folder, limits=ArchiveLimits(**limits))  # pyright: ignore[reportArgumentType]
        except BundleError:
            assert list((tmp_path / "in").iterdir()) == []
            assert sorted(path.name for path in tmp_path.iterdir()) == ["archive", "in"]
            raise
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}

    return attempt


@pytest.mark.parametrize("container", CONTAINERS)
def test_archives_are_told_by_their_content(try_to_unpack, tmp_path: Path, container: str):
    assert try_to_unpack(make(container, CONTENT)) == CONTENT
    modes = {name: stat.S_IMODE((tmp_path / "in" / "folder" / name).stat().st_mode) for name in CONTENT}
    assert {name for name, mode in modes.items() if mode & 0o111} == {"package/run.sh"}
    assert stat.S_IMODE((tmp_path / "in" / "folder").stat().st_mode) == 0o755


@pytest.mark.parametrize("container", CONTAINERS)
def test_folders_and_leading_dots_are_ordinary(try_to_unpack, tmp_path: Path, container: str):
    members = {"./": b"", "./a/": b"", "./a/b": b"content", "a/": b"", "empty/": b"", "c/d/e": b""}
    assert try_to_unpack(make(container, members)) == {"a/b": b"content", "c/d/e": b""}
    assert (tmp_path / "in" / "folder" / "empty").is_dir()


def test_what_the_usual_tools_pack_is_unpacked(try_to_unpack, tmp_path: Path):
    source = tmp_path / "in" / "source"
    for name, content in CONTENT.items():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_bytes(content)
    os.system(f"tar -C {source} -czf {tmp_path}/archive.bin . && rm -r {source}")
    data = (tmp_path / "archive.bin").read_bytes()
    (tmp_path / "archive.bin").unlink()
    assert try_to_unpack(data) == CONTENT


EVIL_NAMES = [
    "/etc/passwd", "../outside", "a/../../outside", "a/./b", "a//b", "..", "a\\b", "..\\outside", "x" * 256, "./../x",
]  # fmt: skip


@pytest.mark.parametrize("name", EVIL_NAMES)
@pytest.mark.parametrize("container", CONTAINERS)
def test_members_that_would_land_elsewhere_are_named(try_to_unpack, container: str, name: str):
    with pytest.raises(BundleError) as caught:
        try_to_unpack(make(container, {"good": b"good", name: b"evil"}))
    assert repr(name) in str(caught.value)


@pytest.mark.parametrize(
    ("kind", "word"),
    [
        (tarfile.SYMTYPE, "symbolic link"),
        (tarfile.LNKTYPE, "hard link"),
        (tarfile.FIFOTYPE, "pipe"),
        (tarfile.CHRTYPE, "device"),
        (tarfile.BLKTYPE, "device"),
        (tarfile.GNUTYPE_SPARSE, "sparse"),
    ],
)
def test_tar_members_that_are_no_files_are_refused(try_to_unpack, kind: bytes, word: str):
    data = make_tar({"good": b"", "odd": b""}, type=kind, linkname="good")
    with pytest.raises(BundleError, match=word):
        try_to_unpack(data)


@pytest.mark.parametrize(("kind", "word"), [(stat.S_IFLNK, "symbolic link"), (stat.S_IFIFO, "pipe")])
def test_zip_members_that_are_no_files_are_refused(try_to_unpack, kind: int, word: str):
    with pytest.raises(BundleError, match=f"'odd'.*{word}"):
        try_to_unpack(make_zip({"odd": b"/etc/passwd"}, kind=kind))


def test_encrypted_zip_members_are_refused(try_to_unpack):
    data = bytearray(make_zip({"locked": b"content"}))
    data[6] |= 1
    data[data.index(b"PK\x01\x02") + 8] |= 1
    with pytest.raises(BundleError, match="'locked': encrypted"):
        try_to_unpack(bytes(data))


def test_nul_in_a_zip_name_is_refused(try_to_unpack):
    with pytest.raises(BundleError, match="NUL"):
        try_to_unpack(make_zip({"good.py_.txt": b""}).replace(b"good.py_.txt", b"good.py\0.txt"))


@pytest.mark.parametrize("container", CONTAINERS)
@pytest.mark.parametrize(
    "names",
    [
        ("a", "A"),
        ("a/x", "A/y"),
        ("é", "e\u0301"),
        ("a", "a/b"),
        ("a/b", "a"),
        ("a/", "a/b", "a"),
        ("straße", "STRASSE"),
    ],
)
def test_names_that_collide_are_refused(try_to_unpack, container: str, names: tuple[str, ...]):
    with pytest.raises(BundleError, match=r"case|both a file and a folder"):
        try_to_unpack(make(container, dict.fromkeys(names, b"")))


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_files_that_are_there_twice_are_refused(try_to_unpack):
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        archive.addfile(tarfile.TarInfo("twice"))
        archive.addfile(tarfile.TarInfo("twice"))
    zipped = io.BytesIO()
    with zipfile.ZipFile(zipped, "w") as archive:
        archive.writestr("twice", b"")
        archive.writestr("twice", b"")
    for data in (buffer.getvalue(), zipped.getvalue()):
        with pytest.raises(BundleError, match="'twice': it is in the archive more than once"):
            try_to_unpack(data)


@pytest.mark.parametrize("container", CONTAINERS)
@pytest.mark.parametrize(
    ("limits", "word"),
    [
        ({"total_bytes": 999}, "999 bytes"),
        ({"file_bytes": 499}, "499 bytes"),
        ({"entries": 2}, "2 files"),
        ({"depth": 2}, "2 components"),
    ],
)
def test_limits_hold_to_the_byte(try_to_unpack, container: str, limits: dict[str, int], word: str):
    data = make(container, {"a": bytes(500), "b/c/d": bytes(500), "e": b""})
    with pytest.raises(BundleError, match=word):
        try_to_unpack(data, **limits)
    try_to_unpack(data, **{name: value + 1 for name, value in limits.items()})


def test_a_bomb_is_stopped_by_what_comes_out_whatever_it_claims(try_to_unpack, tmp_path: Path):
    honest = make_zip({"bomb": bytes(50_000_000)})
    claiming = honest.replace((50_000_000).to_bytes(4, "little"), (10).to_bytes(4, "little"))
    assert claiming != honest
    for data in (honest, claiming, make_tar({"bomb": bytes(50_000_000)}, mode="w:gz")):
        with pytest.raises(BundleError):
            try_to_unpack(data, total_bytes=1_000_000)


def test_a_bomb_below_all_limits_is_told_by_its_ratio(try_to_unpack):
    data = make("tar.gz", {"bomb": bytes(5_000_000)})
    with pytest.raises(BundleError, match="'bomb': with it the archive has more than 200 times its own size"):
        try_to_unpack(data, unsuspicious_bytes=1_000_000)
    assert try_to_unpack(data)  # small enough to be let in
    random = os.urandom(2_000_000)
    assert try_to_unpack(make("tar.gz", {"meshes": random}), unsuspicious_bytes=1_000_000)


@pytest.mark.deep
def test_a_million_entries_are_refused_once_there_are_too_many(try_to_unpack):
    assert ArchiveLimits().entries == 100_000, "which takes ten times as long"
    folder = make_tar({"folder/": b""})[:512]
    data = gzip.compress(folder * 10_000) * 100  # parts of a gzip file may simply be joined
    with pytest.raises(BundleError, match="more than 10000 files and folders"):
        try_to_unpack(data, entries=10_000)


def test_special_modes_and_owners_are_dropped(try_to_unpack, tmp_path: Path):
    try_to_unpack(make_tar({"tool.sh": b""}, mode="w", uid=12345))
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        info = tarfile.TarInfo("setuid")
        info.mode, info.uid = 0o6777, 12345
        archive.addfile(info)
    (tmp_path / "setuid.tar").write_bytes(buffer.getvalue())
    unpack(tmp_path / "setuid.tar", tmp_path / "out")
    found = (tmp_path / "out" / "setuid").stat()
    assert stat.S_IMODE(found.st_mode) == 0o755
    assert found.st_uid == os.geteuid()


@pytest.mark.parametrize(
    "data",
    [b"", b"\0" * 1024, b"text", b"PK\x03\x04", b"\x1f\x8b", gzip.compress(b"no tar", mtime=0)],
    ids=["nothing", "zeros", "text", "zip-beginning", "gzip-beginning", "gzip-of-text"],
)
def test_what_is_no_archive_is_refused(try_to_unpack, data: bytes):
    with pytest.raises(BundleError):
        try_to_unpack(data)


@pytest.mark.parametrize("container", CONTAINERS)
def test_a_truncated_archive_is_refused_wherever_it_ends(try_to_unpack, container: str):
    data = make(container, {"a": os.urandom(700), "b": b"content", "c": b""})
    end = data.rindex(b"content") + 512 * 2 + 1 if container == "tar" else len(data)
    for length in {*range(1, end, 97), end - 1}:
        with pytest.raises(BundleError):
            try_to_unpack(data[:length])


def test_a_damaged_header_is_not_taken_for_the_end(try_to_unpack):
    data = bytearray(make_tar({"a": b"first", "b": b"second"}))
    data[1024 + 150] ^= 0xFF  # in the second member's checksum
    with pytest.raises(BundleError, match="damaged"):
        try_to_unpack(bytes(data))


def test_a_negative_size_does_not_loop(try_to_unpack):
    data = bytearray(make_tar({"a": b"", "b": b""}))
    for start in (0, 512):
        header = data[start : start + 512]
        header[124:136] = b"\xff" * 10 + b"\xfc\x00"  # base-256: -1024
        header[148:156] = b" " * 8
        header[148:156] = f"{sum(header):06o}\0 ".encode()
        data[start : start + 512] = header
    with pytest.raises(BundleError):
        try_to_unpack(bytes(data))


def test_a_header_of_gigabytes_is_not_read(try_to_unpack):
    header = bytearray(make_tar({"a": b""})[:512])
    header[156:157] = b"x"  # what follows are extended attributes of the next member
    header[124:136] = f"{4 << 30:011o}\0".encode()
    header[148:156] = b" " * 8
    header[148:156] = f"{sum(header):06o}\0 ".encode()
    with pytest.raises(BundleError, match="header"):
        try_to_unpack(gzip.compress(bytes(header) + bytes(4096)))


@examples(150, suppress_health_check=(HealthCheck.function_scoped_fixture,))
@given(
    container=st.sampled_from(CONTAINERS),
    changes=st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), min_size=1, max_size=6),
)
def test_whatever_is_damaged_it_unpacks_or_is_refused(tmp_path_factory, container: str, changes: list[tuple[int, int]]):
    data = bytearray(make(container, CONTENT))
    for position, value in changes:
        data[position % len(data)] = value
    folder = tmp_path_factory.mktemp("fuzz")
    (folder / "archive").write_bytes(data)
    try:
        unpack(folder / "archive", folder / "out")
    except BundleError:
        assert [path.name for path in folder.iterdir()] == ["archive"]
    else:
        assert all(not path.is_symlink() for path in (folder / "out").rglob("*"))


def test_a_folder_with_something_in_it_is_not_unpacked_into(tmp_path: Path):
    (tmp_path / "archive").write_bytes(make_zip(CONTENT))
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "mine").write_bytes(b"mine")
    with pytest.raises(StorageError, match="taken"):
        unpack(tmp_path / "archive", tmp_path / "taken")
    assert [path.name for path in (tmp_path / "taken").iterdir()] == ["mine"]


def test_a_full_disk_leaves_nothing(small_disk: Path, tmp_path: Path):
    (tmp_path / "archive").write_bytes(make_tar({"large": bytes(3_000_000)}, mode="w:gz"))
    with pytest.raises(StorageFullError, match="archive"):
        unpack(tmp_path / "archive", small_disk / "folder")
    assert list(small_disk.iterdir()) == []


def test_packing_gives_the_same_bytes_whatever_the_times_and_order(tmp_path: Path):
    for folder, names in (("one", list(CONTENT)), ("two", list(reversed(CONTENT)))):
        for name in names:
            path = tmp_path / folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(CONTENT[name])
            path.chmod(0o755 if name.endswith(".sh") else 0o600)
            os.utime(path, (len(folder + name), 5 if folder == "one" else 7))
        pack_tar_gz(tmp_path / folder, tmp_path / f"{folder}.tar.gz")
    assert (tmp_path / "one.tar.gz").read_bytes() == (tmp_path / "two.tar.gz").read_bytes()
    unpack(tmp_path / "one.tar.gz", tmp_path / "out")
    assert {name: (tmp_path / "out" / name).read_bytes() for name in CONTENT} == CONTENT
    assert (tmp_path / "out" / "package/run.sh").stat().st_mode & 0o100


def test_packing_refuses_links_and_leaves_nothing(tmp_path: Path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "link").symlink_to("/etc/passwd")
    with pytest.raises(StorageError, match="link"):
        pack_tar_gz(tmp_path / "folder", tmp_path / "archive.tar.gz")
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]
