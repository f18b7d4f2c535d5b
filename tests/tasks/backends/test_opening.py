"""Which backend a setting names, and what is said of settings that name none."""

import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.backends.backend import open_backend

_OPEN = """
import sys
sys.path.insert(0, sys.argv[1])
import pkgutil
for module in pkgutil.iter_modules([sys.argv[1]]):
    if module.name.startswith("__editable__"):
        __import__(module.name).install()
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.backends.backend import open_backend
try:
    open_backend(sys.argv[2])
except ConfigurationError as error:
    print(error)
"""


def test_local_batches_have_no_backend() -> None:
    assert open_backend("local") is None


@pytest.mark.parametrize(
    "named",
    ["dask:tcp://10.0.0.7:8786", "dask:tls://head:8786", "dask:head:8786", "ray:head:6379", "ray:ray://[::1]:10001"],
)
def test_nothing_is_connected_by_opening(named: str) -> None:
    assert open_backend(named) is not None


@pytest.mark.parametrize(
    ("named", "said"),
    [
        ("dask:head", "ROBOMAKER_BACKEND is 'dask:head'; after dask: there has to be the address of a scheduler"),
        (
            "dask:",
            "ROBOMAKER_BACKEND is 'dask:'; it has to be local, by-hand, workers:POOL, dask:ADDRESS or ray:ADDRESS",
        ),
        ("ray:auto", "ROBOMAKER_BACKEND is 'ray:auto'; after ray: there has to be the address of a cluster"),
        ("slurm:head:1", "ROBOMAKER_BACKEND is 'slurm:head:1'; it has to be local"),
    ],
)
def test_an_address_that_is_none_is_refused(named: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        open_backend(named)


@pytest.mark.parametrize(("kind", "package"), [("dask", "distributed"), ("ray", "ray")])
def test_an_extra_that_is_not_installed_is_named(kind: str, package: str, tmp_path: Path) -> None:
    for entry in Path(sysconfig.get_path("purelib")).iterdir():
        if entry.name != package:
            (tmp_path / entry.name).symlink_to(entry)

    command = [sys.executable, "-S", "-c", _OPEN, str(tmp_path), f"{kind}:head:1"]
    opened = subprocess.run(command, capture_output=True, text=True, check=True)

    assert f"is not installed: cd {REPOSITORY} && .tools/bin/uv sync --frozen --inexact --extra {kind}" in opened.stdout
