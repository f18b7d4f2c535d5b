"""Job workers' flow runs in work pools of a real Prefect server, without workers that would run them."""

import re
import threading
import time
import uuid
from collections.abc import Iterator
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.tasks.backends import pool_runs
from prefect_robomaker.tasks.backends.backend import BackendError, open_backend
from prefect_robomaker.tasks.backends.pool_runs import Places
from prefect_robomaker.tasks.backends.work_pools import WorkPool, backend_at


@pytest.fixture
def batch() -> str:
    """ARN of a batch of no catalog."""
    return f"arn:aws:robomaker:us-east-1:000000000000:simulation-job-batch/sim-batch-{uuid.uuid4().hex[:12]}"


@pytest.fixture(scope="module")
def client(prefect_server: str) -> Iterator[Any]:
    """A client of the server."""
    from prefect.client.orchestration import get_client

    with get_client(sync_client=True) as made:
        yield made


class Lab:
    """A pool with a deployment of the job worker."""

    def __init__(self, client: Any, kind: str, limit: int | None = None) -> None:
        from prefect.client.schemas.actions import WorkPoolCreate
        from prefect.workers.process import ProcessWorker

        from prefect_robomaker.flows.pool_job_workers import RunJobWorker

        self.client = client
        self.name = f"lab-{uuid.uuid4().hex[:8]}"
        template = ProcessWorker.get_default_base_job_template()
        made = WorkPoolCreate(name=self.name, type=kind, concurrency_limit=limit, base_job_template=template)
        client.create_work_pool(made)
        flow = client.create_flow(RunJobWorker)
        client.create_deployment(
            flow_id=flow, name=self.name, work_pool_name=self.name, entrypoint="a.b", pull_steps=[]
        )

    def come(self, *workers: str) -> None:
        """Workers tell that they are alive."""
        for worker in workers:
            self.client.send_worker_heartbeat(self.name, worker, heartbeat_interval_seconds=1.0)

    def states(self, batch: str) -> list[str]:
        """The states of the runs of a batch; one that is being deleted has none for a moment."""
        return sorted(run.state.type.value for run in self.runs(batch) if run.state is not None)

    def runs(self, batch: str) -> list[Any]:
        from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterTags

        tags = FlowRunFilterTags(all_=[batch.rpartition("/")[2]])
        return self.client.read_flow_runs(flow_run_filter=FlowRunFilter(tags=tags))


def quick(name: str, most: int | None = None) -> WorkPool:
    return WorkPool(name, most, look_s=0.2)


@pytest.mark.parametrize(
    ("place", "made"),
    [
        ("lab", WorkPool("lab")),
        ("lab*4", WorkPool("lab", 4)),
        ("lab*0", WorkPool("lab*0")),
        ("*4", WorkPool("*4")),
        ("my lab*12", WorkPool("my lab", 12)),
    ],
)
def test_a_place_names_a_pool_and_perhaps_a_number(place: str, made: WorkPool) -> None:
    assert backend_at(place) == made
    assert open_backend(f"workers:{place}") == made


def test_a_pool_that_is_not_there_is_said_with_the_command_that_makes_it(prefect_server: str, batch: str) -> None:
    expected = f"the Prefect server at {prefect_server} has no work pool 'nowhere'; `prefect work-pool create nowhere"
    with pytest.raises(BackendError, match=re.escape(expected)), quick("nowhere").job_workers(batch, 2):
        pass


def test_a_pool_without_the_deployment_is_said_with_the_command_that_makes_it(client: Any, batch: str) -> None:
    lab = Lab(client, "process")
    client.delete_deployment(client.read_deployment_by_name(f"RunJobWorker/{lab.name}").id)

    expected = f"`robomaker deploy --job-worker --pool {lab.name}` makes it"
    with pytest.raises(BackendError, match=re.escape(expected)), quick(lab.name).job_workers(batch, 2):
        pass


def test_a_pool_of_containers_wants_a_number(client: Any, batch: str) -> None:
    lab = Lab(client, "docker")

    expected = f"ROBOMAKER_BACKEND=workers:{lab.name}*4 would start four job workers"
    with pytest.raises(BackendError, match=re.escape(expected)), quick(lab.name).job_workers(batch, 2):
        pass


@pytest.mark.parametrize(
    ("limit", "most", "wanted", "count"),
    [
        (3, None, 9, 3),
        pytest.param(None, 2, 9, 2, marks=pytest.mark.deep),
        pytest.param(5, 4, 1, 1, marks=pytest.mark.deep),
    ],
)
def test_a_pool_of_containers_gets_as_many_as_is_said_and_are_wanted(
    client: Any, batch: str, limit: int | None, most: int | None, wanted: int, count: int
) -> None:
    lab = Lab(client, "kubernetes", limit)

    with quick(lab.name, most).job_workers(batch, wanted) as workers:
        wait_for(lambda: f"{count} starting" in workers.look(), "the job workers")
        assert lab.states(batch) == ["SCHEDULED"] * count
        time.sleep(1)
        assert lab.states(batch) == ["SCHEDULED"] * count, "they are started once"

    assert lab.runs(batch) == [], "what has not begun is taken back"


def test_job_workers_follow_the_prefect_workers_that_are_online(client: Any, batch: str) -> None:
    lab = Lab(client, "process")

    def states_with(*workers: str) -> list[str]:
        lab.come(*workers)
        return lab.states(batch)

    with WorkPool(lab.name, look_s=1.0).job_workers(batch, 9) as workers:
        wait_for(lambda: "none of its Prefect workers is online" in workers.look(), "the look")
        # They count as gone three heartbeats later, which is soon: they go on giving them.
        wait_for(lambda: states_with("first") == ["SCHEDULED"], "the first")
        wait_for(lambda: states_with("first", "second") == ["SCHEDULED"] * 2, "the second")
        # They give no sign of life any more.
        wait_for(lambda: lab.states(batch) == [], "that they are taken back")


def test_those_of_a_process_that_has_died_are_taken_over(client: Any, batch: str) -> None:
    from prefect.states import Completed, Running

    lab, begun = Lab(client, "kubernetes"), uuid.uuid4()
    with pytest.raises(KeyError), quick(lab.name, 2).job_workers(batch, 2) as workers:  # noqa: PT012
        wait_for(lambda: "2 starting" in workers.look(), "the job workers")
        begun = lab.runs(batch)[0].id
        client.set_flow_run_state(begun, Running(), force=True)
        with quick(lab.name, 2).job_workers(batch, 2) as others:
            wait_for(lambda: "1 job worker in the work pool" in others.look(), "the other process's look")
            assert lab.states(batch) == ["RUNNING", "SCHEDULED"]
        assert client.read_flow_run(begun).state.is_running(), "it works for the batch, not for a process"
        raise KeyError

    assert client.read_flow_run(begun).state.is_cancelling(), "the batch is not carried out any more"
    client.set_flow_run_state(begun, Completed(), force=True)


def test_each_of_two_batches_has_job_workers_of_its_own(client: Any, batch: str) -> None:
    lab, other = Lab(client, "kubernetes"), f"{batch}-other"
    with quick(lab.name, 2).job_workers(batch, 2), quick(lab.name, 2).job_workers(other, 1) as others:
        wait_for(lambda: "1 starting" in others.look(), "the look")
        wait_for(lambda: (len(lab.runs(batch)), len(lab.runs(other))) == (2, 1), "two and one")


def test_one_that_ends_early_is_replaced_after_a_while(
    client: Any, batch: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from prefect.states import Crashed

    pauses_over = threading.Event()
    missing = Places.missing

    def counted(places: Places, alive: int, room: int, now: float) -> int:
        """As if minutes had passed once the event is set."""
        return missing(places, alive, room, now + (600.0 if pauses_over.is_set() else 0.0))

    monkeypatch.setattr(pool_runs, "_FIRST_PAUSE_S", 60.0)
    monkeypatch.setattr(Places, "missing", counted)
    lab = Lab(client, "kubernetes")
    with quick(lab.name, 1).job_workers(batch, 1) as workers:
        wait_for(lambda: lab.states(batch) == ["SCHEDULED"], "the job worker")
        client.set_flow_run_state(lab.runs(batch)[0].id, Crashed(message="the roof fell in"), force=True)
        wait_for(lambda: "ended as Crashed: the roof fell in" in workers.look(), "that its end is said")
        assert lab.states(batch) == ["CRASHED"], "not at once"
        pauses_over.set()
        wait_for(lambda: lab.states(batch) == ["CRASHED", "SCHEDULED"], "another")


def test_machines_with_other_settings_end_it(client: Any, batch: str) -> None:
    from prefect.states import Failed

    lab = Lab(client, "kubernetes")
    ended = Failed(name="Misconfigured", message="the catalog of this machine, sqlite:///x, does not have it")
    said = "can run the batch: Misconfigured: the catalog of this machine"
    with pytest.raises(BackendError, match=said), quick(lab.name, 3).job_workers(batch, 3) as workers:  # noqa: PT012
        wait_for(lambda: lab.states(batch) == ["SCHEDULED"] * 3, "the job workers")
        for run in lab.runs(batch):
            client.set_flow_run_state(run.id, ended, force=True)
        wait_for(lambda: not workers.look(), "the error")


def test_a_server_that_does_not_answer_breaks_nothing(batch: str) -> None:
    from prefect.settings import PREFECT_API_URL, PREFECT_CLIENT_MAX_RETRIES, temporary_settings

    away = temporary_settings({PREFECT_API_URL: "http://127.0.0.1:9/api", PREFECT_CLIENT_MAX_RETRIES: 0})
    with away, quick("lab").job_workers(batch, 2) as workers:
        wait_for(lambda: "the Prefect server does not answer" in workers.look(), "that it is said")
