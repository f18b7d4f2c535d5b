"""The wheel is all that somebody needs: built from the source archive, installed alone, it runs the quickstart."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY
from helpers.required_programs import needs

UV = shutil.which("uv") or shutil.which(REPOSITORY / ".tools" / "bin" / "uv")
BUILD = "import sys; from setuptools import build_meta; getattr(build_meta, f'build_{sys.argv[1]}')(sys.argv[2])"

pytestmark = [pytest.mark.deep, needs("uv", UV, "uv is not installed")]


def output_of(*command: str | Path, cwd: Path, **variables: str) -> str:
    """Output of a command, which knows neither this project's environment nor its home."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(("ROBOMAKER_", "PREFECT_"))}
    environ = {**inherited, **variables}
    done = subprocess.run(command, cwd=cwd, env=environ, capture_output=True, text=True, timeout=800, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def built(kind: str, source: Path, target: Path) -> Path:
    """The archive that a folder of sources makes."""
    output_of(sys.executable, "-c", BUILD, kind, target, cwd=source)
    return next(target.glob("*.tar.gz" if kind == "sdist" else "*.whl"))


def share_compiled(python: Path) -> None:
    """Gives an environment what this one has compiled of the same files: half a minute of compiling.

    Python takes it only for a file of the same size and time, such as both have from uv's cache.
    """
    here, there = (
        Path(sysconfig.get_path("purelib", vars={"base": str(base)})) for base in (sys.prefix, python.parents[1])
    )
    for folder in here.rglob("__pycache__"):
        sources = there / folder.parent.relative_to(here)
        if sources.is_dir():
            (sources / "__pycache__").mkdir(exist_ok=True)
            for compiled in folder.glob(f"*.{sys.implementation.cache_tag}.pyc"):
                os.link(compiled, sources / "__pycache__" / compiled.name)


def test_the_wheel_alone_runs_the_quickstart(tmp_path: Path) -> None:
    source, empty, home = (tmp_path / name for name in ("source", "empty", "home"))
    for folder in (source, empty, home):
        folder.mkdir()
    tracked = output_of("git", "ls-files", cwd=REPOSITORY).split("\n")
    for name in filter(None, tracked):
        if not name.startswith(("tests/", "docs/")) and (REPOSITORY / name).exists():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(REPOSITORY / name, source / name)
    with tarfile.open(built("sdist", source, tmp_path / "sdist")) as archive:
        archive.extractall(tmp_path / "unpacked", filter="data")
    wheel = built("wheel", next((tmp_path / "unpacked").iterdir()), tmp_path / "wheel")

    assert UV is not None
    # Releases that were locked, not today's: whatever others publish tonight breaks no change here.
    locked = ("--quiet", "--frozen", "--no-dev", "--no-emit-project", "--no-hashes", "--output-file")
    output_of(UV, "export", *locked, tmp_path / "locked.txt", cwd=REPOSITORY)
    output_of(UV, "venv", "--quiet", "--python", sys.executable, tmp_path / "venv", cwd=empty)
    python = tmp_path / "venv" / "bin" / "python"
    output_of(UV, "pip", "install", "--quiet", "--python", python, "-c", tmp_path / "locked.txt", wheel, cwd=empty)
    share_compiled(python)

    robomaker = python.with_name("robomaker")
    try:
        printed = output_of(robomaker, "run", "quickstart", cwd=empty, HOME=str(home))
    finally:
        output_of(robomaker, "server", "stop", "--force", cwd=empty, HOME=str(home))
    assert "4 of 4 jobs passed" in printed
    assert list(empty.iterdir()) == [], "it writes into its home only"
