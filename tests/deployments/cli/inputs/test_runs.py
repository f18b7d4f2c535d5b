"""Which run is meant."""

import json
import os
from pathlib import Path

from prefect_robomaker.deployments.cli.inputs.options import find_record


def record(runs: Path, name: str, text: str) -> Path:
    path = runs / name / "run.json"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    number = len(list(runs.iterdir()))  # the later made, the younger, whatever the clock's steps are
    os.utime(path, (number, number))
    return path


def test_the_latest_run_is_no_probe(tmp_path: Path) -> None:
    whole = record(tmp_path, "a-1", json.dumps({"probe": False}))
    probe = record(tmp_path, "a-2", json.dumps({"probe": True}))
    assert find_record(tmp_path, "latest") == whole
    assert find_record(tmp_path, "a-2") == probe


def test_a_probe_is_found_where_there_is_nothing_else(tmp_path: Path) -> None:
    probe = record(tmp_path, "a-1", json.dumps({"probe": True}))
    assert find_record(tmp_path, "latest") == probe


def test_a_damaged_record_is_not_passed_over(tmp_path: Path) -> None:
    record(tmp_path, "a-1", json.dumps({}))
    damaged = record(tmp_path, "a-2", "{")
    assert find_record(tmp_path, "latest") == damaged
