"""A catalog that is away is waited for, and not what waiting would not mend."""

import logging
from collections.abc import Iterator

import pytest
from helpers.ports import free_port
from helpers.postgres_server import NEEDS_POSTGRESQL

from prefect_robomaker.schemas.wire.errors import CatalogAwayError, ConfigurationError
from prefect_robomaker.tasks.catalog.database import open_engine
from prefect_robomaker.tasks.service.catalog_wait import once_catalog_answers


def away_for(tries: int) -> Iterator[str]:
    for _ in range(tries):
        yield "away"
    yield "there"


@pytest.mark.parametrize(("tries", "patience_s", "opens"), [(0, 0.0, True), (3, 60.0, True), (100, 60.0, False)])
def test_a_catalog_that_is_away_is_waited_for_with_patience_and_that_is_said_once(
    tries: int, patience_s: float, opens: bool, caplog: pytest.LogCaptureFixture
) -> None:
    answers, now_s = away_for(tries), [0.0]

    def open_it() -> str:
        if (answer := next(answers)) == "away":
            raise CatalogAwayError("connection refused")
        return answer

    def sleep(for_s: float) -> None:
        now_s[0] += for_s

    with caplog.at_level(logging.WARNING):
        if opens:
            opened = once_catalog_answers(open_it, patience_s=patience_s, sleep=sleep, clock=lambda: now_s[0])
            assert opened == "there"
        else:
            with pytest.raises(CatalogAwayError):
                once_catalog_answers(open_it, patience_s=patience_s, sleep=sleep, clock=lambda: now_s[0])
            assert now_s[0] == pytest.approx(patience_s, abs=5)
    said = ["waits for the catalog, which does not answer: connection refused", "the catalog answers"]
    assert caplog.messages == (said[: 2 if opens else 1] if tries else [])


@NEEDS_POSTGRESQL
def test_a_server_that_does_not_answer_is_away_and_one_that_refuses_is_not(postgres_database: str) -> None:
    with pytest.raises(CatalogAwayError, match="Connection refused"):
        open_engine(f"postgresql+psycopg://user@127.0.0.1:{free_port()}/catalog")
    with pytest.raises(ConfigurationError, match="does not exist") as refused:
        open_engine(f"{postgres_database}-that-is-not-there")
    assert not isinstance(refused.value, CatalogAwayError)


def test_a_file_that_cannot_be_opened_is_not_waited_for(tmp_path: object) -> None:
    with pytest.raises(ConfigurationError) as refused:
        open_engine(f"sqlite:///{tmp_path}")
    assert not isinstance(refused.value, CatalogAwayError)
