"""Bundles as `colcon bundle` makes them: version 1 and 2, of overlays that a test writes down as files."""

import hashlib
import io
import json
import tarfile
from collections.abc import Mapping
from pathlib import Path

Tree = Mapping[str, str]
"""Files by name: their text, or `-> TARGET` for a symbolic link. Programs begin with `#!`."""

_FIRST_OVERLAY_AT = 4 << 20


def tar_of(tree: Tree, mode: str = "w") -> bytes:
    """A tar archive of a tree; `mode` is that of `tarfile.open`."""
    return _tar({name: text.encode() for name, text in tree.items()}, mode)


def bundle_v1(path: Path, tree: Tree, version: str = "1") -> None:
    """Writes `output.tar.gz` of version 1, whose one overlay has the workspace and what it depends on."""
    parts = {"version": f"{version}\n".encode(), "metadata.tar": tar_of({"installers.json": "{}"})}
    path.write_bytes(_tar({**parts, "bundle.tar": tar_of(tree)}, "w:gz"))


def bundle_v2(path: Path, dependencies: Tree, workspace: Tree, *, sha256: str | None = None) -> None:
    """Writes `output.tar` of version 2; `sha256` takes the place of the right one of the workspace."""
    overlays = {
        "dependencies.tar.gz": tar_of(dependencies, "w:gz"),
        "workspace.tar.gz": tar_of(workspace, "w:gz"),
    }
    listed = [
        {"name": name, "sha256": hashlib.sha256(content).hexdigest(), "offset": 0, "size": len(content)}
        for name, content in overlays.items()
    ]
    listed[-1]["sha256"] = sha256 or listed[-1]["sha256"]
    metadata = {"overlays.json": json.dumps({"overlays": listed}), "installers.json": "{}"}
    beginning = {"version": b"2\n", "metadata.tar.gz": tar_of(metadata, "w:gz")}
    pad = b"\0" * (_FIRST_OVERLAY_AT - len(_tar(beginning, "w")))
    path.write_bytes(_tar({**beginning, "pad": pad, **overlays}, "w"))


def _tar(members: Mapping[str, bytes], mode: str) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode=mode) as archive:  # type: ignore[call-overload]
        for name, content in members.items():
            info = tarfile.TarInfo(name)
            if content.startswith(b"-> "):
                info.type, info.linkname = tarfile.SYMTYPE, content[3:].decode()
            else:
                info.size, info.mode = len(content), 0o755 if content.startswith(b"#!") else 0o644
            archive.addfile(info, io.BytesIO(content) if info.isreg() else None)
    return buffer.getvalue()
