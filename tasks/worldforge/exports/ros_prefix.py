"""ROS install prefix with the packages of an export: `share/`, an ament index, and setup scripts.

```
setup.sh, setup.bash, local_setup.sh, local_setup.bash
share/aws_robomaker_worldforge_worlds/…                        as in the archive of an export
share/aws_robomaker_worldforge_shared_models/…
share/ament_index/resource_index/packages/<package>
```

A simulation job has one with its own world; see `tasks.simulations.inputs.world_packages`.
"""

import tempfile
import zipfile
from pathlib import Path

from .ros_packages import PATH_VARIABLES, SHARED_MODELS, WORLDS

PACKAGES = (WORLDS, SHARED_MODELS)
CONTENTS = {WORLDS: ("worlds", "launch"), SHARED_MODELS: ("models",)}
"""Folders of each exported package whose content depends on the world."""

SETUP_VARIABLE = "AWS_ROBOMAKER_WORLDFORGE_SETUP_OVERRIDE"
"""Environment variable with the prefix's path.

RoboMaker's packages in bundles have hooks that source the setup script there.
"""

_SETUP = """\
# Puts the world of the job before all others; sourced after the setups of ROS and of a workspace.
_worldforge_prefix="${@VARIABLE@:-${BUNDLE_CURRENT_PREFIX:-}}"
_worldforge_first() {  # a variable, and the folder that is to be its first
  eval "_worldforge_rest=\\":\\${$1:-}:\\""
  while :; do
    case "$_worldforge_rest" in
      *":$2:"*) _worldforge_rest="${_worldforge_rest%%":$2:"*}:${_worldforge_rest#*":$2:"}" ;;
      *) break ;;
    esac
  done
  _worldforge_rest="${_worldforge_rest#:}"
  _worldforge_rest="${_worldforge_rest%:}"
  eval "export $1=\\"\\$2\\${_worldforge_rest:+:\\$_worldforge_rest}\\""
}
if [ -d "$_worldforge_prefix/share/@WORLDS@" ]; then
@LINES@
else
  echo "$_worldforge_prefix has no world of the job; @VARIABLE@ has to name it" >&2
fi
unset _worldforge_prefix _worldforge_rest
unset -f _worldforge_first
"""


def first_on_paths(prefix: str) -> dict[str, list[str]]:
    """Returns the environment variables, with folders to put first, by which ROS and Gazebo find packages.

    Args:
        prefix: Path of the prefix as the program that uses it sees it.
    """
    models = [f"{prefix}/share/{package}/{CONTENTS[package][0]}" for package in (SHARED_MODELS, WORLDS)]
    return {
        "ROS_PACKAGE_PATH": [f"{prefix}/share"],
        "AMENT_PREFIX_PATH": [prefix],
        **dict.fromkeys(PATH_VARIABLES, models),
    }


def world_map(prefix: Path, name: str) -> Path:
    """Returns the path of a world's Nav2 map in an install prefix."""
    return prefix / "share" / WORLDS / "worlds" / name / "map.yaml"


def write_ros_prefix(name: str, bundle: Path, folder: Path) -> None:
    """Writes the ROS packages of one world to an install prefix.

    Args:
        name: The world's name in archives.
        bundle: Folder of its bundle.
        folder: The prefix; it may not be there yet.

    Raises:
        ValueError: The bundle holds no world.
        OSError: The world cannot be read, or the folder cannot be written.
    """
    from .export import TOP, write_export_zip  # brings MuJoCo, which planning a job does without

    folder.mkdir(parents=True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        archive = Path(scratch, "export.zip")
        write_export_zip({name: bundle}, archive)
        with zipfile.ZipFile(archive) as content:
            content.extractall(scratch)
        Path(scratch, TOP).rename(folder / "share")
    index = folder / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    for package in PACKAGES:
        (index / package).touch()
    for script in ("setup.sh", "setup.bash", "local_setup.sh", "local_setup.bash"):
        (folder / script).write_text(_setup(), encoding="utf-8")


def _setup() -> str:
    found = first_on_paths("$_worldforge_prefix").items()
    # What is put in front last is first.
    lines = [f'  _worldforge_first {name} "{place}"' for name, places in found for place in reversed(places)]
    text = _SETUP.replace("@LINES@", "\n".join(lines)).replace("@VARIABLE@", SETUP_VARIABLE)
    return text.replace("@WORLDS@", WORLDS)
