"""The thread that follows a cluster."""

from collections.abc import Callable

import pytest
from helpers.processes import wait_for

from prefect_robomaker.tasks.backends.backend import BackendError
from prefect_robomaker.tasks.backends.cluster_workers import cluster_workers
from prefect_robomaker.tasks.backends.node import Ended

Ends = Callable[[str], Ended | None]


class Job:
    """A job worker of `Machines`."""

    def __init__(self, machine: str, ends: Ends) -> None:
        self._machine = machine
        self._ends = ends

    def ended(self) -> Ended | None:
        return self._ends(self._machine)


class Machines:
    """A cluster of the test's own, whose machines and troubles the test says."""

    place = "the cluster"

    def __init__(self, *machines: str, ends: Ends = lambda _: None) -> None:
        self.there = list(machines)
        self.ends = ends
        self.started: list[str] = []
        self.trouble: Exception | None = None
        self.over = False

    def machines(self) -> list[str]:
        if self.trouble:
            raise self.trouble
        return self.there

    def start(self, machine: str, batch: str) -> Job:
        if machine == "broken":
            raise OSError("no route")
        self.started.append(machine)
        return Job(machine, self.ends)

    def end_all(self, patience_s: float) -> None:
        self.over = True


def test_machines_that_come_later_get_job_workers_and_all_are_ended() -> None:
    cluster = Machines("a")
    with cluster_workers(cluster, "arn", 2) as workers:
        wait_for(lambda: workers.look() == "1 job worker on the cluster", "the first")
        cluster.there = ["a", "b"]
        wait_for(lambda: workers.look() == "2 job workers on the cluster", "the second")
        assert not cluster.over

    assert cluster.started == ["a", "b"]
    assert cluster.over


def test_a_cluster_that_goes_away_is_waited_for() -> None:
    cluster = Machines("a")
    with cluster_workers(cluster, "arn", 1) as workers:
        wait_for(lambda: "1 job worker" in workers.look(), "the first")
        cluster.trouble = TimeoutError("10 s")
        wait_for(lambda: workers.look() == "the cluster does not answer: TimeoutError: 10 s", "the trouble")
        cluster.trouble = None
        wait_for(lambda: workers.look() == "1 job worker on the cluster", "its end")


def test_a_machine_that_cannot_be_reached_is_told_of() -> None:
    with cluster_workers(Machines("a", "broken"), "arn", 2) as workers:
        wait_for(lambda: workers.look() == "1 job worker on the cluster; broken: no route", "what is said of it")


def test_wrong_settings_everywhere_reach_the_batch() -> None:
    cluster = Machines("a", ends=lambda machine: Ended(machine, 2, "robomaker: no catalog"))

    def refused() -> bool:
        with pytest.raises(BackendError, match="a: robomaker: no catalog"):
            workers.look()
        return True

    with cluster_workers(cluster, "arn", 2) as workers:
        wait_for(lambda: workers._error is not None, "the error")
        assert refused()
    assert cluster.over
