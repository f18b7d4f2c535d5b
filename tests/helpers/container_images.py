"""Root file systems for container images, made of programs of this machine: no registry is needed."""

import io
import os
import re
import shutil
import subprocess
import sys
import tarfile
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from prefect_robomaker.tasks.runtime.agents import agent_client

PROGRAMS = ("bash", "cat", "chmod", "chown", "head", "env", "id", "ln", "mkdir", "rm", "sleep", "stat", "tail", "touch")
USER_ID = 1234
"""Of the user `robo` of every image."""

_ACCOUNTS = f"root:x:0:0:root:/root:/bin/bash\nrobo:x:{USER_ID}:{USER_ID}::/home/robomaker:/bin/bash\n"
_LEFT_OUT = {
    "test",
    "tests",
    "idlelib",
    "lib2to3",
    "ensurepip",
    "tkinter",
    "site-packages",
    "pydoc_data",
}
_CACHE_TAG = f".{sys.implementation.cache_tag}.pyc"


def write_root(archive: Path, *, python: bool = False, programs: Sequence[str] = PROGRAMS) -> None:
    """Writes a small root file system: bash and a few programs, users, files where jobs have folders.

    Args:
        archive: The `.tar` to write.
        python: Whether Python is in it, with `/robot/agent_client.py`.
        programs: What is in `/bin`.
    """
    with tarfile.open(archive, "w") as tar:
        added: set[str] = set()

        def add(path: Path, name: str) -> None:
            if name in added:
                return
            added.add(name)
            for parent in reversed(PurePosixPath(name).parents[:-1]):
                if str(parent) not in added:  # engines let only root look into folders that are in no archive
                    added.add(str(parent))
                    _add(tar, str(parent).lstrip("/"), mode=0o755)
            tar.add(path.resolve(), arcname=name.lstrip("/"), recursive=False)
            for library in _libraries(path):
                add(Path(library), library)

        for program in programs:
            found = shutil.which(program)
            assert found is not None, f"{program} is not on the path"
            add(Path(found), f"/bin/{program}")
        if python:
            for path, name in _python_files():
                add(path, name)
        _add_link(tar, "bin/sh", "bash")
        for folder, mode in (("tmp", 0o1777), ("etc", 0o755), ("proc", 0o755), ("sys", 0o755), ("dev", 0o755)):
            _add(tar, folder, mode=mode)
        _add(tar, "etc/passwd", _ACCOUNTS.encode())
        _add(tar, "home", mode=0o755)
        _add(tar, "home/robomaker", mode=0o755, owner=USER_ID)
        _add(tar, "home/robomaker/workspace", mode=0o755, owner=USER_ID)
        _add(tar, "home/robomaker/workspace/built.txt", b"in the image\n", owner=USER_ID)
        _add(tar, "home/robomaker/secret.txt", b"of root\n", mode=0o600)


def _python_files() -> Iterator[tuple[Path, str]]:
    """This Python with its standard library, compiled: containers keep nothing, so each would compile it anew."""
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    base = Path(sys.base_prefix)
    yield base / "bin" / version, "/usr/bin/python3"
    library = base / "lib" / version
    for folder, folders, names in os.walk(library):
        folders[:] = [name for name in folders if name not in _LEFT_OUT and not name.startswith("config-")]
        is_cache = Path(folder).name == "__pycache__"
        for name in names:
            if is_cache and not name.endswith(_CACHE_TAG):
                continue  # what other versions, and `python -O`, have compiled
            path = Path(folder, name)
            yield path, f"/usr/lib/{version}/{path.relative_to(library)}"
    yield Path(agent_client.__file__), "/robot/agent_client.py"


def _libraries(path: Path) -> list[str]:
    """The shared libraries that a program or library needs, the loader included."""
    with path.open("rb") as content:
        if content.read(4) != b"\x7fELF":
            return []
    listed = subprocess.run(["ldd", str(path)], capture_output=True, text=True, check=False).stdout
    return re.findall(r"(/\S+) \(0x", listed)


def _add(tar: tarfile.TarFile, name: str, content: bytes | None = None, *, mode: int = 0o644, owner: int = 0) -> None:
    """Adds a file, or a folder when there is no content."""
    member = tarfile.TarInfo(name)
    member.uid = member.gid = owner
    member.mode = mode
    if content is None:
        member.type = tarfile.DIRTYPE
    else:
        member.size = len(content)
    tar.addfile(member, io.BytesIO(content or b""))


def _add_link(tar: tarfile.TarFile, name: str, target: str) -> None:
    member = tarfile.TarInfo(name)
    member.type, member.linkname = tarfile.SYMTYPE, target
    tar.addfile(member)
