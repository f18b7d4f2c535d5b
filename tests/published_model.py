"""The service's last published model: from a botocore that is installed into a folder of its own, once."""

import gzip
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

BOTOCORE = "botocore==1.40.60"  # the last release that has the service
FOLDER = Path("botocore/data/robomaker/2018-06-29")
FILES = ("service-2.json.gz", "paginators-1.json")

Model = dict[str, Any]


def published_files(config: pytest.Config) -> Mapping[str, bytes]:
    """The model's files by name, without `.gz`; skips the test where they cannot be had."""
    assert config.cache is not None
    kept = config.cache.mkdir("robomaker-model") / BOTOCORE
    if not kept.exists():
        with tempfile.TemporaryDirectory() as folder:
            _install(Path(folder))
            fetched = kept.with_name(f"{kept.name}.{os.getpid()}")
            fetched.mkdir()
            for name in FILES:
                shutil.copy(Path(folder) / FOLDER / name, fetched)
            try:
                fetched.replace(kept)
            except OSError:  # another worker was faster
                shutil.rmtree(fetched)
    contents = {name: (kept / name).read_bytes() for name in FILES}
    return {
        name.removesuffix(".gz"): gzip.decompress(content) if name.endswith(".gz") else content
        for name, content in contents.items()
    }


def _install(folder: Path) -> None:
    reasons = []
    for command in _installers(folder):
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        if done.returncode == 0:
            return
        reasons.append(f"{' '.join(command[:3])}: {done.stderr.strip()[-200:]}")
    pytest.skip(f"{BOTOCORE} cannot be installed: {'; '.join(reasons) or 'neither uv nor pip is there'}")


def _installers(folder: Path) -> list[list[str]]:
    options = ["install", "--quiet", "--no-deps", "--target", str(folder), BOTOCORE]
    commands = []
    if importlib.util.find_spec("pip"):
        commands.append([sys.executable, "-m", "pip", *options])
    if uv := shutil.which("uv"):
        commands.append([uv, "pip", *options, "--python", sys.executable])
    if pip := shutil.which("pip"):
        commands.append([pip, *options])
    return commands
