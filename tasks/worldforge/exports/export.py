"""The archive of a world export job: two ROS packages with every world and the models they share.

```
aws_robomaker_worldforge_pkgs/
    README.md
    index.json
    aws_robomaker_worldforge_shared_models/{CMakeLists.txt,README.md,package.xml,env-hooks,models/<model>/…}
    aws_robomaker_worldforge_worlds/{CMakeLists.txt,README.md,package.xml,env-hooks,launch/…}
    aws_robomaker_worldforge_worlds/worlds/<world>/{<world>.world,model.sdf,<world>.glb, the bundle's files}
```
"""

import hashlib
import json
import re
import stat
import tempfile
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ....schemas.worlds.world import PREVIEW_FILE
from ...files.whole_files import replaced
from ..bundle.bundle import MODEL_FILE, NAMES_FILE, with_plain_names
from ..bundle.robot_map import MAP_FILES, write_robot_map
from ..pictures.preview import render_preview
from .export_readme import readme
from .export_scene import Scene, read_scene
from .glb import scene_glb
from .ros_packages import SHARED_MODELS, WORLDS, package_files
from .sdf_worlds import SharedModels, sdf_world
from .usd import scene_usd

TOP = "aws_robomaker_worldforge_pkgs"
_WORLD_ID = re.compile(r"[A-Za-z0-9_\-]{1,128}")
_EARLIEST = (1980, 1, 1, 0, 0, 0)
"""Time stamp of all files in the archive, the earliest that zip can hold: equal worlds then give equal archives."""
_COMPRESSED_ALREADY = frozenset({".png", ".jpg", ".jpeg", ".gz", ".zip", ".mp4"})
_FIRST_GENERATOR = 3
"""First generator version whose worlds have plain names (letters, digits and `_`) in exports."""
_CHUNK_BYTES = 1 << 20


def write_export_zip(bundles: Mapping[str, Path], path: Path) -> None:
    """Writes the archive of exported worlds (ROS packages, Gazebo, USD, ...); equal worlds give equal bytes.

    Args:
        bundles: The folder of each world's bundle, by the world's name in archives, such as
            `generation_82856b0yq33y_world_3`.
        path: The archive; it appears when it is whole.

    Raises:
        FileNotFoundError: A bundle is missing or lacks `world.json` or `world.xml`.
        ValueError: There is no bundle, a name cannot be a folder's, or a bundle holds no world or something
            that is neither a regular file nor a folder.
        OSError: A bundle cannot be read or the archive cannot be written.
    """
    if not bundles:
        raise ValueError("bundles is empty; an export has at least one world")
    for name in bundles:
        if not _WORLD_ID.fullmatch(name):
            raise ValueError(f"world {name!r}: a name in archives has 1 to 128 letters, digits, '_' and '-'")
    with replaced(path) as part, zipfile.ZipFile(part, "x") as archive:
        _Export(archive).write(bundles)


def archive_name(world_id: str) -> str:
    """Returns a world's name in export archives: its id with underscores, `generation_82856b0yq33y_world_3`."""
    return world_id.replace("-", "_").replace("/", "_")


def _files(folder: Path, prefix: str = "") -> list[str]:
    """Returns the paths of a folder's files, at any depth, relative to it and sorted.

    Raises ValueError for a symbolic link or another special file, which could name any file of this machine.
    """
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


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(f"{TOP}/{name}", date_time=_EARLIEST)
    stored = Path(name).suffix.lower() in _COMPRESSED_ALREADY
    entry.compress_type = zipfile.ZIP_STORED if stored else zipfile.ZIP_DEFLATED
    entry.external_attr = (stat.S_IFREG | 0o644) << 16
    return entry


def _written_anew(scene: Scene, bundle: Path) -> dict[str, bytes]:
    """Returns the files that an export writes anew: with plain names, or with table legs in place of outlines.

    Worlds of generators before version 3 have none: they stay as they were made.
    """
    if int(scene.world.generator_version.partition(".")[0]) < _FIRST_GENERATOR:
        return {}
    model = with_plain_names((bundle / MODEL_FILE).read_text(encoding="utf-8"))
    names = json.dumps(model.names, indent=1, sort_keys=True) + "\n"
    with tempfile.TemporaryDirectory() as scratch:
        write_robot_map(scene, Path(scratch))
        maps = {relative: Path(scratch, relative).read_bytes() for relative in MAP_FILES}
    return {MODEL_FILE: model.mjcf.encode(), NAMES_FILE: names.encode(), **maps}


class _Export:
    """Writes the archive of a world export."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self._files: list[dict[str, Any]] = []
        """Entries of `index.json` for the files of the package that is being written."""

    def write(self, bundles: Mapping[str, Path]) -> None:
        names = sorted(bundles)
        shared = SharedModels()
        worlds = [self._world(name, bundles[name], shared) for name in names]
        models = [
            {"name": name, "path": folder, "files": self._part(folder, shared.files[name])}
            for name, folder in ((name, f"{SHARED_MODELS}/models/{name}") for name in sorted(shared.files))
        ]
        packages = self._part("", {**package_files(names), "README.md": readme(names)})
        index = {"schema_version": 2, "worlds": worlds, "models": models, "files": packages}
        self._part("", {"index.json": json.dumps(index, indent=1, ensure_ascii=False) + "\n"})

    def _world(self, name: str, bundle: Path, shared: SharedModels) -> dict[str, Any]:
        """Adds a world's files to the export; returns its entry for the index."""
        folder = f"{WORLDS}/worlds/{name}"
        scene = read_scene(bundle)
        anew = _written_anew(scene, bundle)
        for relative in _files(bundle):
            if relative not in anew:
                with (bundle / relative).open("rb") as source:
                    self._add(f"{folder}/{relative}", iter(lambda: source.read(_CHUNK_BYTES), b""))
        for relative, content in anew.items():
            self._add(f"{folder}/{relative}", [content])
        if not (bundle / PREVIEW_FILE).exists():
            self._add(f"{folder}/{PREVIEW_FILE}", [render_preview(scene.world)])
        made = sdf_world(scene, name, shared)
        texts = {f"{name}.world": made.world, **made.building}
        for relative in sorted(texts):
            self._add(f"{folder}/{relative}", [texts[relative].encode()])
        self._add(f"{folder}/{name}.glb", [scene_glb(scene)])
        self._add(f"{folder}/{name}.usda", [scene_usd(scene).encode()])
        return {"id": name, "path": folder, "models": list(made.models), "files": self._taken()}

    def _part(self, folder: str, texts: Mapping[str, str]) -> list[dict[str, Any]]:
        """Adds text files below a folder; returns their entries for the index."""
        for relative in sorted(texts):
            self._add(f"{folder}/{relative}" if folder else relative, [texts[relative].encode()])
        return self._taken()

    def _add(self, name: str, content: Iterable[bytes]) -> None:
        digest = hashlib.sha256()
        size = 0
        with self._archive.open(_entry(name), "w") as target:
            for chunk in content:
                target.write(chunk)
                digest.update(chunk)
                size += len(chunk)
        self._files.append({"path": name, "size_bytes": size, "sha256": digest.hexdigest()})

    def _taken(self) -> list[dict[str, Any]]:
        files, self._files = self._files, []
        return files
