"""Processes that are Prefect workers, and their pools; the rest is in `tests/journeys/test_dead_nights.py`."""

import pytest

from prefect_robomaker.deployments.worker.beside_prefect import is_prefect_worker, pools_of


@pytest.mark.parametrize(
    ("words", "pools"),
    [
        ("/usr/bin/prefect worker start --pool nights --type process", ["nights"]),
        ("/lib/prefect/__main__.py worker start -p nights", ["nights"]),
        ("/usr/bin/prefect worker start --pool=nights", ["nights"]),
    ],
)
def test_prefect_workers(words: str, pools: list[str]) -> None:
    assert is_prefect_worker(words.split())
    assert pools_of(words.split()) == pools


@pytest.mark.parametrize(
    "words",
    [
        "/usr/bin/prefect server start",
        "/usr/bin/prefect flow-run execute",
        "/lib/robomaker/__main__.py worker start",
        "",
    ],
)
def test_other_processes(words: str) -> None:
    assert not is_prefect_worker(words.split())
