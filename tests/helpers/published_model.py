"""The service's last published model: from a botocore that is installed into a folder of its own, once."""

import gzip
import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from helpers.package_installer import install_packages

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
            install_packages(BOTOCORE, target=Path(folder))
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
