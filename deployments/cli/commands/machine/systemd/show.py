"""Print the units, with the paths of this installation."""

import argparse
import sys
from pathlib import Path


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds no arguments: `robomaker systemd show` has none."""


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker systemd show`: prints the systemd units."""
    from .....systemd.unit_files import units

    del arguments
    for name, text in units(Path(sys.executable).parent).items():
        sys.stdout.write(f"# --- {name}\n{text}\n")
    return 0
