"""Patience with an object store: how long an outage costs, what is waited for, and who hears of it."""

import itertools
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.errors import (
    BucketNotFoundError,
    ObjectExistsError,
    ObjectNotFoundError,
    ServiceUnavailableException,
    StorageAccessDeniedError,
    StorageError,
    StorageFullError,
    StorageUnavailableError,
)
from prefect_robomaker.tasks.service.store_retries import Patience


@dataclass
class Outage:
    """A store on a clock of its own that does not answer until some time."""

    until_s: float
    call_s: float = 0.0
    """How long a call takes until it fails."""
    probe_s: float = 0.0
    now_s: float = 0.0
    calls: int = 0
    notes: list[str] = field(default_factory=list)

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds

    def call(self) -> str:
        self.calls += 1
        return self._answer(self.call_s)

    def probe(self) -> None:
        self._answer(self.probe_s)

    def _answer(self, takes_s: float) -> str:
        if self.now_s < self.until_s:
            self.now_s += takes_s
            raise StorageUnavailableError("503 Slow Down")
        return "stored"

    def patience(self, patience_s: float = 1800.0, stopped: Callable[[], bool] | None = None) -> Patience:
        given = {} if stopped is None else {"stopped": stopped}
        return Patience(patience_s, 1.0, **given, note=self.notes.append, sleep=self.sleep, clock=lambda: self.now_s)


@given(
    until_s=st.floats(20.0, 1500.0),
    # What ten attempts of an S3 client take until they give up, and one with its timeout.
    call_s=st.floats(0.0, 26.0),
    probe_s=st.floats(0.0, 4.0),
)
def test_work_goes_on_soon_after_the_store_answers(until_s: float, call_s: float, probe_s: float) -> None:
    outage = Outage(until_s, call_s, probe_s)

    assert outage.patience().ask(outage.call, outage.probe) == "stored"

    assert outage.now_s <= 1.125 * max(until_s, call_s) + probe_s + 1.0
    assert outage.calls == 2, "in between the store is only probed"


@given(patience_s=st.floats(0.0, 500.0))
def test_a_call_is_given_up_when_patience_is_over_and_not_before(patience_s: float) -> None:
    outage = Outage(until_s=1e9)

    with pytest.raises(StorageUnavailableError, match="503"):
        outage.patience(patience_s).ask(outage.call, outage.probe)

    assert outage.now_s <= patience_s
    assert outage.now_s + max(1.0, outage.now_s / 8) > patience_s


@pytest.mark.parametrize(
    "kind", [BucketNotFoundError, ObjectNotFoundError, StorageAccessDeniedError, ObjectExistsError, StorageError]
)
def test_what_no_waiting_mends_is_raised_at_once(kind: type[StorageError]) -> None:
    outage = Outage(0.0)

    def refuse() -> None:
        raise kind("no")

    with pytest.raises(kind):
        outage.patience().ask(refuse, outage.probe)
    assert (outage.now_s, outage.notes) == (0.0, [])


def test_a_full_store_is_waited_for() -> None:
    outage = Outage(0.0)
    answers = iter([StorageFullError("no space left"), None])

    def store() -> str:
        if error := next(answers):
            raise error
        return "stored"

    assert outage.patience().ask(store, outage.probe) == "stored"


def test_those_who_watch_hear_once_of_the_wait_and_once_of_its_end() -> None:
    outage = Outage(100.0)

    outage.patience().ask(outage.call, outage.probe)

    begun, ended = outage.notes
    assert begun == "waits for the object store, at most 30 min: 503 Slow Down"
    assert ended.startswith("the object store answers again, after 1")


def test_a_stop_ends_the_wait_within_half_a_second() -> None:
    outage = Outage(1e9)

    with pytest.raises(StorageUnavailableError):
        outage.patience(stopped=lambda: outage.now_s > 100.0).ask(outage.call, outage.probe)

    assert 100.0 < outage.now_s <= 100.5


def test_a_catalog_that_is_away_too_ends_no_wait() -> None:
    outage = Outage(10.0)

    def unknown() -> bool:
        raise ServiceUnavailableException("the database starts again")

    assert outage.patience(stopped=unknown).ask(outage.call, outage.probe) == "stored"


def test_a_stop_leaves_a_call_that_hangs_to_itself() -> None:
    outage, hangs, stopped = Outage(1e9), threading.Event(), threading.Event()

    def hang() -> None:
        stopped.set()
        hangs.wait()

    with pytest.raises(StorageUnavailableError):
        outage.patience(stopped=stopped.is_set).ask(hang, outage.probe)
    hangs.set()


def test_a_stop_breaks_off_no_call_that_the_store_works_on() -> None:
    """A long upload of a job that is cancelled meanwhile comes to its end."""
    outage, looked = Outage(0.0), threading.Event()

    def probe() -> None:
        outage.probe()
        looked.set()

    assert outage.patience(stopped=lambda: True).ask(looked.wait, probe) is True


def test_a_call_that_hangs_is_given_up_when_patience_is_over() -> None:
    outage, hangs = Outage(1e9, probe_s=100.0), threading.Event()
    outage.now_s = 0.0
    times = itertools.count(step=20)
    patience = Patience(90.0, 1.0, note=outage.notes.append, sleep=outage.sleep, clock=lambda: float(next(times)))

    with pytest.raises(StorageUnavailableError):
        patience.ask(lambda: hangs.wait(), outage.probe)

    hangs.set()
    assert outage.notes == ["waits for the object store, at most 1.5 min: 503 Slow Down"]


def test_what_a_call_raises_and_returns_comes_through_its_thread() -> None:
    patience = Outage(0.0).patience(stopped=lambda: False)

    assert patience.ask(lambda: 7, lambda: None) == 7
    with pytest.raises(TimeoutError, match="its own"):
        patience.ask(lambda: (_ for _ in ()).throw(TimeoutError("its own")), lambda: None)
