"""Bundles that are unpacked, and those that are refused and leave nothing behind."""

import io
import stat
import tarfile
import zipfile
from pathlib import Path

import pytest
from helpers.colcon_bundles import bundle_v1, bundle_v2
from helpers.tuf_repository import bundle

from prefect_robomaker.tasks.fleet.agent.bundles.colcon import overlays
from prefect_robomaker.tasks.fleet.agent.bundles.extraction import ArchiveLimits
from prefect_robomaker.tasks.fleet.agent.child.unpacking import unpack
from prefect_robomaker.tasks.fleet.agent.errors import StepFailed


def tar(*members: tarfile.TarInfo | str, content: bytes = b"x") -> bytes:
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w") as container:
        for member in members:
            info = tarfile.TarInfo(member) if isinstance(member, str) else member
            info.size = len(content) if info.isreg() else 0
            container.addfile(info, io.BytesIO(content))
    return packed.getvalue()


def special(kind: bytes, name: str = "link") -> tarfile.TarInfo:
    info = tarfile.TarInfo(name)
    info.type, info.linkname = kind, "/etc/passwd"
    return info


def zipped(name: str, mode: int = stat.S_IFREG | 0o755) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as container:
        info = zipfile.ZipInfo(name)
        info.external_attr = mode << 16
        container.writestr(info, "x")
    return packed.getvalue()


def put(tmp_path: Path, packed: bytes) -> Path:
    archive = tmp_path / "archive"
    archive.write_bytes(packed)
    return archive


@pytest.mark.parametrize("packed", [bundle({"bin/drive": "x"}), tar("bin/drive"), zipped("bin/drive")])
def test_all_kinds_of_archives(packed: bytes, tmp_path: Path) -> None:
    unpack(put(tmp_path, packed), tmp_path / "versions" / "1")

    assert (tmp_path / "versions/1/bin/drive").read_text() == "x"
    assert [path.name for path in (tmp_path / "versions").iterdir()] == ["1"]


def test_programs_stay_programs_and_special_modes_go(tmp_path: Path) -> None:
    unpack(put(tmp_path, bundle({"drive": "x"}, mode=0o4777)), tmp_path / "1")

    assert stat.S_IMODE((tmp_path / "1/drive").stat().st_mode) == 0o755


def test_a_version_that_is_there_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "1").mkdir()
    unpack(put(tmp_path, b"no archive"), tmp_path / "1")


def test_what_an_interrupted_try_left_is_replaced(tmp_path: Path) -> None:
    (tmp_path / ".1.part").mkdir()
    (tmp_path / ".1.part/old").touch()
    unpack(put(tmp_path, bundle({"drive": "x"})), tmp_path / "1")

    assert [path.name for path in (tmp_path / "1").iterdir()] == ["drive"]


@pytest.mark.parametrize(
    "packed",
    [
        b"",
        b"no archive",
        bundle({"drive": "x" * 5000})[:-60],
        tar("../drive"),
        tar("/drive"),
        tar("a/../../drive"),
        tar("a//drive"),
        tar("drive", "drive"),
        tar("Drive", "drive"),
        tar("a", "a/drive"),
        tar("a\\drive"),
        tar("a/" * 40 + "drive"),
        tar(special(tarfile.SYMTYPE)),
        tar(special(tarfile.LNKTYPE)),
        tar(special(tarfile.FIFOTYPE)),
        tar(special(tarfile.CHRTYPE)),
        tar(special(tarfile.SYMTYPE, "a"), "a/drive"),
        tar("drive")[:700],
        zipped("../drive"),
        zipped("link", stat.S_IFLNK | 0o777),
        zipped("drive")[:-5],
    ],
    ids=range(21),  # bytes with the time in them are no names
)
def test_bad_bundles_leave_nothing(packed: bytes, tmp_path: Path) -> None:
    archive = put(tmp_path, packed)
    with pytest.raises(StepFailed) as caught:
        unpack(archive, tmp_path / "versions" / "1")

    assert caught.value.code == "ExtractingBundleFailure"
    assert list((tmp_path / "versions").iterdir()) == []


@pytest.mark.parametrize(
    "limits", [ArchiveLimits(entries=1), ArchiveLimits(total_bytes=1500), ArchiveLimits(ratio=1, unsuspicious_bytes=0)]
)
def test_bundles_that_hold_too_much(limits: ArchiveLimits, tmp_path: Path) -> None:
    with pytest.raises(StepFailed, match="more than"):
        unpack(put(tmp_path, bundle({"a": "x" * 1000, "b": "y" * 1000})), tmp_path / "1", limits)


OVERLAY = {"setup.sh": "", "usr/bin/tool": "-> ../lib/tool-1", "usr/lib/tool-1": "#!/bin/sh\n", "out": "-> /etc/passwd"}


@pytest.mark.parametrize("version", [1, 2])
def test_bundles_of_colcon_are_unpacked_to_their_overlays(version: int, tmp_path: Path) -> None:
    archive, folder = tmp_path / "archive", tmp_path / "versions" / "1"
    if version == 1:
        bundle_v1(archive, OVERLAY)
    else:
        bundle_v2(archive, {"setup.sh": ""}, OVERLAY)
    unpack(archive, folder)

    last = overlays(folder)[-1]
    assert [path.name for path in overlays(folder)] == (["bundle"] if version == 1 else ["dependencies", "workspace"])
    assert (last / "usr/bin/tool").resolve() == (last / "usr/lib/tool-1").resolve()
    assert not (last / "out").is_symlink()
    assert not list(folder.glob("*.tar*"))


def test_bundles_of_colcon_that_are_wrong_leave_nothing(tmp_path: Path) -> None:
    bundle_v1(tmp_path / "newer", OVERLAY, version="3")
    bundle_v1(tmp_path / "hostile", {"setup.sh": "", "../../drive": ""})
    bundle_v2(tmp_path / "damaged", OVERLAY, OVERLAY, sha256="0" * 64)
    for name, said in {
        "newer": "a colcon bundle of version '3'",
        "hostile": "bundle.tar of the colcon bundle: member '../../drive'",
        "damaged": "workspace.tar.gz is not what overlays.json says",
    }.items():
        with pytest.raises(StepFailed, match=said) as caught:
            unpack(tmp_path / name, tmp_path / "versions" / "1")
        assert caught.value.code == "ExtractingBundleFailure"
        assert list((tmp_path / "versions").iterdir()) == []
