"""Which run is meant."""

import json
import os
from pathlib import Path

import pytest

from prefect_robomaker.deployments.cli.inputs.options import find_record, find_run
from prefect_robomaker.schemas.wire.errors import ConfigurationError


def record(runs: Path, name: str, text: str) -> Path:
    path = runs / name / "run.json"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    number = 1000 - len(list(runs.iterdir()))  # the later made, the older: times of files tell nothing
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


def begun(runs: Path, name: str) -> Path:
    order = runs / name / "order.json"
    order.parent.mkdir(parents=True)
    order.touch()
    return order.parent


def test_the_latest_run_may_still_go_on(tmp_path: Path) -> None:
    """Else the results of the night before would be taken for those of this night."""
    before = record(tmp_path, "a-20260301T020000000", "{}").parent
    assert find_run(tmp_path, "latest") == before
    goes_on = begun(tmp_path, "b-20260302T020000000")
    assert find_run(tmp_path, "latest") == goes_on
    assert find_run(tmp_path, goes_on.name) == find_run(tmp_path, str(goes_on)) == goes_on
    after = record(tmp_path, "a-20260303T020000000", "{}").parent
    assert find_run(tmp_path, "latest") == after
    assert find_run(tmp_path, before.name) == before


def test_a_first_run_that_goes_on_is_found_and_others_are_not(tmp_path: Path) -> None:
    goes_on = begun(tmp_path, "b-20260302T020000000")
    assert find_run(tmp_path, "latest") == goes_on
    with pytest.raises(ConfigurationError, match="there are no runs"):
        find_run(tmp_path, "other")


def test_the_name_of_a_specification_is_its_newest_run_but_no_probe(tmp_path: Path) -> None:
    record(tmp_path, "night-20260301T020000000", "{}")
    newest = record(tmp_path, "night-20260302T020000000", "{}")
    record(tmp_path, "night-20260303T020000000", json.dumps({"probe": True}))
    other = record(tmp_path, "night-b-20260304T020000000", "{}")
    assert find_record(tmp_path, "night") == newest
    assert find_record(tmp_path, "night-b") == other
    with pytest.raises(ConfigurationError, match="'night-2026' may be any of 3 runs"):
        find_record(tmp_path, "night-2026")
    goes_on = begun(tmp_path, "night-20260305T020000000")
    begun(tmp_path, "night-b-20260306T020000000")
    assert find_run(tmp_path, "night") == goes_on
    assert find_run(tmp_path, "night-20260302") == newest.parent


def test_a_first_run_that_goes_on_is_not_taken_for_a_run_of_a_specification_with_a_longer_name(tmp_path: Path) -> None:
    goes_on = begun(tmp_path, "night-20260301T020000000")
    record(tmp_path, "night-b-20260302T020000000", "{}")
    assert find_run(tmp_path, "night") == goes_on


def test_a_name_does_not_mean_the_run_of_a_longer_name(tmp_path: Path) -> None:
    other = record(tmp_path, "night-b-20260304T020000000", "{}")
    with pytest.raises(ConfigurationError, match=r"there is no run 'night'.*did you mean 'night-b' or 'night-b-2026"):
        find_record(tmp_path, "night")
    assert find_record(tmp_path, "night-b-2026") == other
