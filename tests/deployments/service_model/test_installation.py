"""The model in `~/.aws/models`, where SDKs look without being told."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from prefect_robomaker.deployments.service_model.installation import (
    DATA_PATH,
    FILES,
    MODEL_FOLDER,
    Installation,
    data_path,
    install,
    uninstall,
)
from prefect_robomaker.schemas.wire.errors import ConfigurationError


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the model goes, in a home folder of its own."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("AWS_DATA_PATH", raising=False)
    return tmp_path / ".aws" / "models" / "robomaker" / "2018-06-29"


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


SHIPPED = contents(MODEL_FOLDER)
PROBE = """
import boto3
client = boto3.client("robomaker", "us-east-1", aws_access_key_id="key", aws_secret_access_key="secret")
print(client.can_paginate("list_worlds"), *(name for name in client.waiter_names if "export" in name))
"""


def test_installed_models_are_found_by_sessions_without_settings(folder: Path) -> None:
    assert install() == Installation(folder, written=FILES)

    assert contents(folder) == SHIPPED
    # botocore looks up the home folder once, when it is imported.
    ended = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True, check=True)
    assert ended.stdout.split() == ["True", "world_export_job_completed"]


def test_installing_again_changes_nothing(folder: Path) -> None:
    install()
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}

    again = install()

    assert again == Installation(folder)
    assert not again.changed
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == before


def test_another_version_of_ours_is_replaced(folder: Path) -> None:
    install()
    older = json.loads(SHIPPED["service-2.json"])
    del older["operations"]["ListWorlds"]
    (folder / "service-2.json").write_text(json.dumps(older))
    (folder / "waiters-2.json").unlink()

    assert install() == Installation(folder, written=("waiters-2.json",), replaced=("service-2.json",))
    assert contents(folder) == SHIPPED


@pytest.mark.parametrize("foreign", ['{"metadata": {"serviceFullName": "AWS RoboMaker"}}', "[]", "no JSON"])
def test_a_model_from_elsewhere_is_replaced_only_by_force(foreign: str, folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / "service-2.json").write_text(foreign)

    with pytest.raises(ConfigurationError, match=r"holds another model \(service-2.json\); .* --force"):
        install()
    with pytest.raises(ConfigurationError, match="holds another model, which was not installed from here"):
        uninstall()
    assert contents(folder) == {"service-2.json": foreign.encode()}

    assert install(force=True).replaced == ("service-2.json",)
    assert contents(folder) == SHIPPED


def test_uninstalling_leaves_other_models_and_other_files(folder: Path) -> None:
    install()
    (folder / "notes.txt").write_text("mine")
    other = folder.parents[1] / "other"
    other.mkdir()

    assert uninstall() == Installation(folder, removed=FILES)
    assert contents(folder) == {"notes.txt": b"mine"}
    assert other.exists()
    assert not uninstall().changed


def test_uninstalling_removes_empty_folders(folder: Path) -> None:
    install()
    uninstall()

    assert not folder.parent.exists()
    assert not uninstall().changed


def test_the_data_path_keeps_what_is_in_it() -> None:
    ours = str(DATA_PATH)

    assert data_path({}) == ours
    assert data_path({"AWS_DATA_PATH": "/a"}) == f"{ours}{os.pathsep}/a"
    assert data_path({"AWS_DATA_PATH": f"/a{os.pathsep}{ours}"}) == f"{ours}{os.pathsep}/a"
