"""Who gets the next free slot: priority, then the batch with fewer jobs here, then who has waited longest."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.machine import slot_files
from prefect_robomaker.tasks.machine.slot_files import WaiterRecord


@dataclass(frozen=True)
class Waiter:
    """A waiter as its place among the others is decided by."""

    ticket: str
    batch: str | None
    priority: int
    since_s: float


def may_begin(ticket: str, waiters: Sequence[Waiter], running: Mapping[str | None, int], free: int) -> bool:
    records = {
        each.ticket: WaiterRecord(pid=1, name="a job", batch=each.batch, priority=each.priority, since_s=each.since_s)
        for each in waiters
    }
    return slot_files.may_begin(ticket, records, running, free)


BATCHES = st.sampled_from(["a", "b", "c", None])
WAITERS = st.lists(
    st.builds(Waiter, st.uuids().map(str), BATCHES, st.integers(-2, 2), st.floats(0.0, 10.0)),
    min_size=1,
    max_size=6,
    unique_by=lambda waiter: waiter.ticket,
)
RUNNING = st.dictionaries(BATCHES, st.integers(0, 5))


def begin(waiters: list[Waiter], running: Counter[str | None], slots: int) -> Counter[str | None]:
    """Fills free slots one after the other, with waiters that want every slot."""
    for _ in range(slots):
        [first] = [waiter for waiter in waiters if may_begin(waiter.ticket, waiters, running, 1)]
        running[first.batch] += 1
    return running


@given(WAITERS, RUNNING)
def test_one_slot_is_for_exactly_one_waiter_and_none_has_a_higher_priority(
    waiters: list[Waiter], running: dict[str | None, int]
) -> None:
    [first] = [waiter for waiter in waiters if may_begin(waiter.ticket, waiters, running, 1)]

    assert first.priority == max(waiter.priority for waiter in waiters)
    equals = [waiter for waiter in waiters if waiter.priority == first.priority]
    fewest = min(running.get(waiter.batch, 0) for waiter in equals)
    assert running.get(first.batch, 0) == fewest
    alike = [waiter for waiter in equals if running.get(waiter.batch, 0) == fewest]
    assert first.since_s == min(waiter.since_s for waiter in alike)


@given(WAITERS, RUNNING, st.integers(0, 8))
def test_more_free_slots_hold_back_no_waiter_that_fewer_let_through(
    waiters: list[Waiter], running: dict[str | None, int], free: int
) -> None:
    for waiter in waiters:
        if may_begin(waiter.ticket, waiters, running, free):
            assert may_begin(waiter.ticket, waiters, running, free + 1)


@given(WAITERS, RUNNING, st.integers(1, 8))
def test_a_free_slot_never_stays_free_for_want_of_a_turn(
    waiters: list[Waiter], running: dict[str | None, int], free: int
) -> None:
    assert any(may_begin(waiter.ticket, waiters, running, free) for waiter in waiters)


@given(st.integers(2, 5), st.integers(1, 40), st.data())
def test_batches_of_one_priority_get_equally_many_slots(batches: int, slots: int, data: st.DataObject) -> None:
    since = st.floats(0.0, 10.0)
    waiters = [Waiter(str(number), str(number), 0, data.draw(since)) for number in range(batches)]

    counts = begin(waiters, Counter(), slots)

    assert max(counts.values()) - min(counts.get(waiter.batch, 0) for waiter in waiters) <= 1


def test_a_batch_of_higher_priority_gets_every_slot_that_becomes_free() -> None:
    slow, urgent = Waiter("1", "slow", 0, 0.0), Waiter("2", "urgent", 1, 5.0)

    counts = begin([slow, urgent], Counter({"slow": 2}), 2)

    assert counts == {"slow": 2, "urgent": 2}
    assert not may_begin("1", [slow, urgent], counts, 3)


def test_jobs_that_are_in_no_batch_share_as_one_batch() -> None:
    alone = [Waiter(f"alone-{number}", None, 0, 0.0) for number in range(8)]
    batch = Waiter("batch", "batch", 0, 9.0)

    assert may_begin("batch", [*alone, batch], {None: 1}, 1)
    assert not may_begin("batch", [*alone, batch], {None: 1, "batch": 2}, 1)
    assert may_begin("alone-0", [*alone, batch], {None: 1, "batch": 2}, 1)
    assert not may_begin("alone-1", [*alone, batch], {None: 1, "batch": 1}, 2)
    assert may_begin("alone-7", alone, {}, 8), "each wants one slot only"


def test_slots_that_become_free_together_need_no_look_for_each() -> None:
    first = Waiter("1", "a", 0, 0.0)
    second = replace(first, ticket="2", batch="b", since_s=1.0)

    assert may_begin("1", [first, second], {}, 2)
    assert may_begin("2", [first, second], {}, 2)
