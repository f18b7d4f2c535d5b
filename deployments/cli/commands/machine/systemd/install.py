"""Write the units to where systemd looks for those of your own user.

They go into ~/.config/systemd/user, and a file for settings into ~/.config/robomaker; nothing is started.
"""

import argparse
import os
import sys
from pathlib import Path


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds no arguments: `robomaker systemd install` has none."""


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker systemd install`: writes systemd's unit files of this user, and prints their paths.

    Nothing is enabled or started; the commands that do so go to standard error.
    """
    from .....systemd.unit_files import install

    del arguments
    for path in install(Path(sys.executable).parent, os.environ):
        sys.stdout.write(f"{path}\n")
    sys.stderr.write(
        "\nSettings go into the file `environment` of ~/.config/robomaker. Then, for example:\n"
        "  systemctl --user daemon-reload\n"
        "  systemctl --user enable --now robomaker-prefect robomaker-worker robomaker-gc.timer\n"
        "  loginctl enable-linger    # so that they run also while you are logged out\n"
    )
    return 0
