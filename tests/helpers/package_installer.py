"""Packages from the index, installed where a test wants them and this project does not see them."""

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.paths import REPOSITORY


def install_packages(
    *requirements: str, target: Path | None = None, python: Path | None = None, built: str | None = None
) -> None:
    """Installs wheels with whichever of pip and uv is there; skips the test where none of them can.

    Args:
        *requirements: What to install, such as `botocore==1.40.60`.
        target: Folder for the packages alone, without what they need.
        python: Interpreter of the environment that gets the packages and what they need.
        built: A package of which there is only the source.
    """
    reasons = []
    for command in _installers(target, python, built):
        done = subprocess.run([*command, *requirements], capture_output=True, text=True, timeout=240, check=False)
        if done.returncode == 0:
            return
        reasons.append(f"{' '.join(command[:3])}: {done.stderr.strip()[-200:]}")
    wanted = ", ".join(requirements)
    pytest.skip(f"{wanted} cannot be installed: {'; '.join(reasons) or 'neither uv nor pip is there'}")


def _installers(target: Path | None, python: Path | None, built: str | None) -> list[list[str]]:
    where = ["--no-deps", "--target", str(target)] if target else []
    sources = ["--no-binary", built] if built else []
    options = ["install", "--quiet", "--only-binary", ":all:", *sources, *where]
    of_pip = ["--python", str(python)] if python else []
    commands = []
    # That of a checkout is a tenth as long at it as pip.
    if uv := shutil.which("uv") or shutil.which(REPOSITORY / ".tools" / "bin" / "uv"):
        commands.append([uv, "pip", *options, "--python", str(python or sys.executable)])
    if importlib.util.find_spec("pip"):
        commands.append([sys.executable, "-m", "pip", *of_pip, *options])
    if pip := shutil.which("pip"):
        commands.append([pip, *of_pip, *options])
    return commands
