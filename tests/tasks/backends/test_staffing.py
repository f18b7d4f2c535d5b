"""Which machines get job workers, and when."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.backends.backend import BackendError
from prefect_robomaker.tasks.backends.cluster_workers import FIRST_PAUSE_S, LONGEST_PAUSE_S, STEADY_S, Staffing
from prefect_robomaker.tasks.backends.node import Ended

WRONG = Ended("first", 2, "robomaker: the catalog of this machine does not have the batch\n")
KILLED = Ended("first", -9, "")
DONE = Ended("first", 0, "robomaker: ran 3 jobs\n")
MACHINES = ("a", "b", "c", "d")


def test_as_many_machines_are_taken_as_can_be_of_use() -> None:
    staffing = Staffing("the cluster", 2)

    assert staffing.to_start(("a", "b", "c"), 0.0) == ["a", "b"]
    assert staffing.words == "2 job workers on the cluster"


def test_another_machine_takes_over_and_the_pauses_of_the_first_grow() -> None:
    staffing = Staffing("the cluster", 1)
    now, ended_at, pauses = 0.0, 0.0, []
    for _ in range(8):
        assert staffing.to_start(("a",), now) == ["a"]
        now += 5.0
        staffing.ended("a", KILLED, now)
        ended_at = now
        while not staffing.to_start(("a",), now):
            now += 0.5
        pauses.append(now - ended_at)
        staffing.ended("a", KILLED, now)
        now += LONGEST_PAUSE_S

    assert pauses == [1, 4, 16, 60, 60, 60, 60, 60]
    assert staffing.to_start(("a", "b"), ended_at) == ["b"]
    assert staffing.words == "1 job worker on the cluster; first: exit code -9"


def test_pauses_begin_anew_after_a_job_worker_that_lasted() -> None:
    staffing = Staffing("the cluster", 1)
    for start, end in ((0.0, 1.0), (10.0, 11.0), (20.0, 20.0 + STEADY_S)):
        assert staffing.to_start(("a",), start) == ["a"]
        staffing.ended("a", KILLED, end)

    assert staffing.to_start(("a",), 20.0 + STEADY_S + FIRST_PAUSE_S) == ["a"]


def test_settings_that_are_wrong_on_every_machine_are_an_error_once_all_have_said_so() -> None:
    staffing = Staffing("the cluster", 1)
    assert staffing.to_start(("a", "b"), 0.0) == ["a"]
    staffing.ended("a", WRONG, 1.0)
    assert staffing.to_start(("a", "b"), 1.0) == ["b"]
    staffing.ended("b", WRONG._replace(host="second"), 2.0)

    with pytest.raises(BackendError, match="no machine of the cluster can run jobs: first: robomaker: the catalog"):
        staffing.to_start(("a", "b"), 2.0)


@pytest.mark.parametrize("code", [0, 130])
def test_wrong_settings_are_waited_out_where_work_was_done(code: int) -> None:
    staffing = Staffing("the cluster", 1)
    staffing.to_start(("a",), 0.0)
    staffing.ended("a", Ended("first", code, ""), 1.0)
    assert staffing.to_start(("a",), 3.0) == ["a"]
    staffing.ended("a", WRONG, 4.0)

    assert staffing.to_start(("a",), 4.0) == []
    assert staffing.words.startswith("no job worker runs on the cluster now; first: robomaker: the catalog")


def test_a_cluster_without_machines_is_waited_for() -> None:
    staffing = Staffing("the cluster", 1)

    assert staffing.to_start((), 0.0) == []
    assert staffing.words == "the cluster has no machine yet"


def test_few_of_many_reasons_are_said() -> None:
    staffing = Staffing("the cluster", 9)
    names = [f"m{number}" for number in range(9)]
    staffing.to_start(names, 0.0)
    for name in names:
        staffing.ended(name, Ended(name, 3, "broken"), 1.0)
    staffing.to_start(names, 1.0)

    assert staffing.words.endswith("; m0: broken; m1: broken; m2: broken; and 6 more like these")


@given(
    wanted=st.integers(1, 4),
    steps=st.lists(
        st.tuples(
            st.lists(st.sampled_from(MACHINES), unique=True),
            st.lists(st.tuples(st.sampled_from(MACHINES), st.sampled_from((DONE, KILLED, WRONG))), max_size=3),
            st.floats(0, 100),
        ),
        max_size=30,
    ),
)
def test_never_too_many_never_twice_and_no_machine_is_forgotten(
    wanted: int, steps: list[tuple[list[str], list[tuple[str, Ended]], float]]
) -> None:
    staffing, now = Staffing("the cluster", wanted), 0.0
    running: dict[str, float] = {}
    last: dict[str, tuple[float, Ended]] = {}
    proven = False
    for present, ends, pause_s in steps:
        now += pause_s
        for name, ended in ends:
            if name in running:
                lasted = now - running.pop(name) >= STEADY_S
                proven = proven or ended is DONE or (ended is KILLED and lasted)
                last[name] = (now, ended)
                staffing.ended(name, ended, now)
        all_refuse = bool(present) and all(name in last and last[name][1] is WRONG for name in present)
        if all_refuse and not running and not proven:
            with pytest.raises(BackendError):
                staffing.to_start(present, now)
            return
        chosen = staffing.to_start(present, now)
        assert not set(running).intersection(chosen)
        assert set(chosen) <= set(present)
        assert len(chosen) == len(set(chosen))
        assert len(running) + len(chosen) <= wanted
        running.update(dict.fromkeys(chosen, now))
        if len(running) < wanted:  # what is left out has ended not long ago
            assert all(now - last[name][0] < LONGEST_PAUSE_S for name in present if name not in running)
        assert staffing.words.startswith(f"{len(running)} job worker" if running else ("no job", "the cluster has no"))
