"""Show a world in 3D.

In MuJoCo's viewer where there is a display; otherwise as an HTML page of one file that any
browser shows without a network, whose path is printed.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ....arguments import add_open, add_world
from ....output import answers

if TYPE_CHECKING:
    from ....inputs.world_lookup import FoundWorld


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker world view` to its parser."""
    add_world(parser)
    parser.add_argument("--html", metavar="FILE", help="write the page there, whether there is a display or not")
    add_open(parser, "show the page in a browser, or do not (either makes a page)")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker world view`: shows a world in 3D in MuJoCo's window, or else writes a web page of it.

    The page is written where `--html` or `--open` asks for it, and where there is no display or MuJoCo's viewer
    fails; its path is printed.
    """
    from ....inputs.world_lookup import find_world, output_file

    found = find_world(arguments.world)
    if arguments.html is None and arguments.open is None and has_display() and _mujoco_viewer(found):
        return 0
    from ......tasks.files.whole_files import write_whole
    from ......tasks.worldforge.viewer.viewer_page import viewer_page

    path = Path(arguments.html) if arguments.html else output_file(found.id or found.name, "views", ".html")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, viewer_page(found.folder, _title(found)))
    sys.stdout.write(f"{path}\n")
    if answers.opens_files(arguments.open):
        answers.open_file(path)
    return 0


def has_display(environ: Mapping[str, str] | None = None, platform: str = sys.platform) -> bool:
    """Whether a window can be opened here: on a desktop, not in a remote session."""
    environ = os.environ if environ is None else environ
    if environ.get("CI"):
        return False
    if platform in ("darwin", "win32"):
        return "SSH_CONNECTION" not in environ
    return bool(environ.get("DISPLAY") or environ.get("WAYLAND_DISPLAY"))


def _mujoco_viewer(found: "FoundWorld") -> bool:
    """Opens MuJoCo's viewer in a process of its own, and waits until it is closed.

    Returns False if the viewer failed, and prints the reason on standard error.
    """
    model = found.folder / "world.xml"
    sys.stderr.write("MuJoCo's viewer is opening; this command ends when it is closed.\n")
    # A process of its own: on a machine whose graphics are broken it crashes.
    ended = subprocess.run(
        [sys.executable, "-m", "mujoco.viewer", f"--mjcf={model}"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        check=False,
    )
    if ended.returncode == 0:
        return True
    said = ended.stderr.strip().splitlines()
    why = said[-1] if said else f"it ended with code {ended.returncode}"
    sys.stderr.write(f"MuJoCo's viewer does not work here ({why}); here is a page for browsers instead:\n")
    return False


def _title(found: "FoundWorld") -> str:
    return f"{found.name} ({found.id})" if found.id and found.id != found.name else found.name
