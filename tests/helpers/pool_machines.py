"""Machines of a Prefect work pool: Prefect workers as processes with homes of their own."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import UUID

from helpers.processes import alive, descendants, started, wait_for
from prefect_robomaker.schemas.settings import Settings

ENDED_S = 20


@dataclass(frozen=True)
class Machine:
    """A Prefect worker that runs one flow run at a time."""

    process: subprocess.Popen[str]
    home: Path
    log: Path

    def kill(self) -> None:
        """Kills it with its flow process and all that this has started, as a power cut would."""
        for pid in {self.process.pid, *descendants(self.process.pid)}:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue

    def flow_process(self) -> int | None:
        """The process of the flow run that goes on."""
        for pid in sorted(descendants(self.process.pid)):
            try:
                words = Path(f"/proc/{pid}/cmdline").read_bytes()
            except OSError:
                continue
            if b"prefect.engine" in words or b"prefect\x00flow-run" in words:
                return pid
        return None


@dataclass(frozen=True)
class Pool:
    """A process work pool that has a deployment of the job worker."""

    name: str
    variables: Mapping[str, str]
    folder: Path

    @contextmanager
    def machine(self, name: str, **more: str) -> Iterator[Machine]:
        """Starts a machine; at the end it is told to stop, and all that it has started is gone."""
        home = self.folder / name
        home.mkdir()
        environ = {
            **self.variables,
            "ROBOMAKER_HOME": str(home / "robomaker"),
            "PREFECT_HOME": str(home / "prefect"),
            "PREFECT_WORKER_QUERY_SECONDS": "2",
            "PREFECT_WORKER_HEARTBEAT_SECONDS": "4",
            "ROBOMAKER_MAX_JOBS": "1",
            **more,
        }
        command = [sys.executable, "-m", "prefect", "worker", "start", "--pool", self.name, "--limit", "1"]
        command += ["--name", name]
        log = home / "worker.log"
        with log.open("w") as output, started(command, environ, stdout=output, stderr=subprocess.STDOUT) as process:
            machine = Machine(process, home / "robomaker", log)
            try:
                yield machine
            finally:
                began = {process.pid, *descendants(process.pid)}
                process.send_signal(signal.SIGINT)
                try:
                    process.wait(ENDED_S)
                except subprocess.TimeoutExpired:
                    machine.kill()
                for pid in alive(began):
                    os.kill(pid, signal.SIGKILL)

    def runs(self, batch: str) -> list[Any]:
        """The flow runs of a batch's job workers, as Prefect knows them."""
        from prefect.client.orchestration import get_client
        from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterTags

        tags = FlowRunFilterTags(all_=[batch.rpartition("/")[2]])
        with get_client(sync_client=True) as client:
            return client.read_flow_runs(flow_run_filter=FlowRunFilter(tags=tags))

    def running(self, batch: str, count: int, timeout_s: float = 180.0) -> list[Any]:
        """Waits until so many job workers run; returns their flow runs."""

        def look() -> list[Any]:
            found = [run for run in self.runs(batch) if run.state_type.value == "RUNNING"]
            return found if len(found) >= count else []

        return wait_for(look, f"{count} job workers that run", timeout_s)

    def ended(self, batch: str, timeout_s: float = 180.0) -> list[Any]:
        """Waits until none is scheduled or runs; returns those that were."""
        deadline = time.monotonic() + timeout_s
        while True:
            runs = self.runs(batch)
            left = [f"{run.name}: {run.state}" for run in runs if run.state is None or not run.state.is_final()]
            if not left:
                return runs
            assert time.monotonic() < deadline, f"job workers that have not ended: {left}"
            time.sleep(0.5)


def deployed_pool(settings: Settings, prefect_url: str, folder: Path) -> Pool:
    """Makes a pool with Prefect's client, and the job worker's deployment as `robomaker deploy --job-worker` does."""
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.actions import WorkPoolCreate
    from prefect.workers.process import ProcessWorker

    from prefect_robomaker.deployments.deploying.deployables import job_worker_deployable
    from prefect_robomaker.deployments.deploying.registration import Target, register

    name = f"pool-{folder.name}-{os.getpid()}"
    template = ProcessWorker.get_default_base_job_template()
    with get_client(sync_client=True) as client:
        client.create_work_pool(WorkPoolCreate(name=name, type="process", base_job_template=template))
    register([job_worker_deployable(name)], Target(pool=name))
    variables = {
        "PREFECT_API_URL": prefect_url,
        "ROBOMAKER_CATALOG_URL": settings.catalog_url,
        "ROBOMAKER_OBJECT_STORE": settings.object_store,
    }
    return Pool(name, variables, folder)


def cancel_in_prefect(run: UUID) -> None:
    """Cancels a flow run as `prefect flow-run cancel` does."""
    from prefect.client.orchestration import get_client
    from prefect.states import Cancelling

    with get_client(sync_client=True) as client:
        client.set_flow_run_state(run, Cancelling())
