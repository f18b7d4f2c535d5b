"""Opening the report."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path


def wanted(choice: bool | None, environ: Mapping[str, str] | None = None) -> bool:
    """Whether to open a browser: as the user chose, otherwise only for a person at a desktop's terminal."""
    if choice is not None:
        return choice
    environ = os.environ if environ is None else environ
    desktop = bool(environ.get("DISPLAY") or environ.get("WAYLAND_DISPLAY"))
    remote = "SSH_CONNECTION" in environ or bool(environ.get("CI"))
    return desktop and not remote and sys.stdout.isatty() and sys.stderr.isatty()


def open_file(path: Path) -> None:
    """Shows a file in the browser; says so when there is none."""
    _open(path.resolve().as_uri(), str(path))


def open_address(address: str) -> None:
    """Shows a page of a server in the browser; says so when there is none."""
    _open(address, address)


def _open(address: str, name: str) -> None:
    import webbrowser

    if not webbrowser.open(address):
        sys.stderr.write(f"No browser could be started; open {name} yourself.\n")
