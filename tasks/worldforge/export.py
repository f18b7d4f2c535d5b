"""The archive of a world export job: one zip with every world's bundle, laid out like the service's.

```
aws_robomaker_worldforge_pkgs/
    README.md
    index.json
    aws_robomaker_worldforge_worlds/worlds/<world id>/…
```
"""

import hashlib
import json
import re
import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from uuid import uuid4

_TOP = "aws_robomaker_worldforge_pkgs"
_WORLDS = "aws_robomaker_worldforge_worlds/worlds"
_WORLD_ID = re.compile(r"[A-Za-z0-9_\-]{1,128}")
_EXPORT_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9\-]{0,63}")
_EARLIEST = (1980, 1, 1, 0, 0, 0)
"""A zip cannot say less; equal worlds make equal archives."""
_COMPRESSED_ALREADY = frozenset({".png", ".jpg", ".jpeg", ".gz", ".zip", ".mp4"})
_CHUNK_BYTES = 1 << 20

_README = """\
# Exported worlds

This archive holds {count}. `index.json` lists every file with its size and SHA-256.

Each folder below `{worlds}/` is one world:

| file | what it is |
| --- | --- |
| `world.xml` | the world as MJCF, self-contained, for MuJoCo 3 |
| `world.json` | rooms, walls, passages and furniture with their poses and sizes, seeds, and what became of the wishes |
| `map.pgm`, `map.yaml` | occupancy grid for Nav2's map server |
| `floorplan.svg`, `preview.png` | the plan with names, and the furnished world from above |

Lengths are metres, angles radians; x points east, y north, z up; the floor is z = 0, and a cylinder of
1 m diameter at the origin is free.

## Look at a world

    python -m mujoco.viewer --mjcf={worlds}/{example}/world.xml

## Load it

    import mujoco
    model = mujoco.MjModel.from_xml_path("{worlds}/{example}/world.xml")
    data = mujoco.MjData(model)

A robot is added with `mujoco.MjSpec`:

    world = mujoco.MjSpec.from_file("{worlds}/{example}/world.xml")
    robot = mujoco.MjSpec.from_file("robot.xml")
    world.attach(robot, prefix="robot/", frame=world.worldbody.add_frame())
    model = world.compile()

## Navigate in it

    ros2 run nav2_map_server map_server --ros-args -p yaml_filename:={worlds}/{example}/map.yaml
"""


def write_export_zip(bundles: Mapping[str, Path], path: Path) -> None:
    """Writes the archive; equal bundles make equal bytes, whatever their order, times and owners.

    Args:
      bundles: the folder of each world's bundle, by the world's name in archives, such as
        `generation_82856b0yq33y_world_3`.
      path: the archive; it appears when it is whole.

    Raises:
      ValueError: there is no bundle, a name cannot be a folder's, or a bundle holds something that is
        neither a regular file nor a folder.
      OSError: a bundle cannot be read or the archive cannot be written.
    """
    if not bundles:
        raise ValueError("bundles is empty; an export has at least one world")
    for name in bundles:
        if not _WORLD_ID.fullmatch(name):
            raise ValueError(f"world {name!r}: a name in archives has 1 to 128 letters, digits, '_' and '-'")
    temporary = path.with_name(f".{uuid4().hex}.part")
    try:
        with zipfile.ZipFile(temporary, "x") as archive:
            worlds = [_write_world(archive, name, bundles[name]) for name in sorted(bundles)]
            index = {"schema_version": 1, "worlds": worlds}
            _write_text(archive, "index.json", json.dumps(index, indent=2, ensure_ascii=False) + "\n")
            _write_text(archive, "README.md", _readme(sorted(bundles)))
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def export_key(prefix: str, export_id: str) -> str:
    """The key of an export job's archive, where the service's own clients look for it.

    Args:
      prefix: the output location's prefix; may be empty.
      export_id: the export job's id, with or without `export-` in front.

    Raises:
      ValueError: that is no id.
    """
    bare_id = export_id.removeprefix("export-")
    if not _EXPORT_ID.fullmatch(bare_id):
        raise ValueError(f"export id {export_id!r}: expected something like 'export-82856b0yq33y'")
    name = f"aws-robomaker-worldforge-export-{bare_id}.zip"
    return f"{prefix.strip('/')}/{name}" if prefix.strip("/") else name


def _write_world(archive: zipfile.ZipFile, name: str, bundle: Path) -> dict[str, Any]:
    """Adds a world's files; returns its entry for the index."""
    folder = f"{_WORLDS}/{name}"
    files = [
        {"path": f"{folder}/{relative}", **_write_file(archive, f"{folder}/{relative}", bundle / relative)}
        for relative in _files(bundle)
    ]
    return {"id": name, "path": folder, "files": files}


def _files(folder: Path, prefix: str = "") -> list[str]:
    """Paths of a folder's files; symbolic links are refused, as they could name any file of this machine."""
    names = []
    for path in folder.iterdir():
        name, mode = prefix + path.name, path.lstat().st_mode
        if stat.S_ISDIR(mode):
            names += _files(path, f"{name}/")
        elif stat.S_ISREG(mode):
            names.append(name)
        else:
            raise ValueError(f"{path} is neither a regular file nor a folder; a bundle has nothing else")
    return sorted(names)


def _write_file(archive: zipfile.ZipFile, name: str, path: Path) -> dict[str, Any]:
    digest = hashlib.sha256()
    size = 0
    with path.open("rb") as source, archive.open(_entry(name), "w") as target:
        while chunk := source.read(_CHUNK_BYTES):
            target.write(chunk)
            digest.update(chunk)
            size += len(chunk)
    return {"size_bytes": size, "sha256": digest.hexdigest()}


def _write_text(archive: zipfile.ZipFile, name: str, text: str) -> None:
    with archive.open(_entry(name), "w") as target:
        target.write(text.encode())


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(f"{_TOP}/{name}", date_time=_EARLIEST)
    stored = Path(name).suffix.lower() in _COMPRESSED_ALREADY
    entry.compress_type = zipfile.ZIP_STORED if stored else zipfile.ZIP_DEFLATED
    entry.external_attr = (stat.S_IFREG | 0o644) << 16
    return entry


def _readme(names: list[str]) -> str:
    count = "one world" if len(names) == 1 else f"{len(names)} worlds"
    return _README.format(count=count, worlds=_WORLDS, example=names[0])
