"""Services with stored runs and jobs, of which some are to go."""

from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pytest
from helpers.s3_server import S3Server

from prefect_robomaker.schemas.documents.simulation_jobs import ReusedFrom, SimulationJobDocument
from prefect_robomaker.schemas.documents.worlds import StoredPlace
from prefect_robomaker.schemas.reports.report import RunState
from prefect_robomaker.schemas.reports.run_record import JobRecord, RunRecord, StepRecord
from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.files.untrusted_folders import regular_files
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import publish

BUCKET = "their-own-bucket"
RESULT = RunResult(
    verdict="PASS", sim_time_s=1.0, wall_time_s=0.1, real_time_factor=10.0, ended_by="agent", seed=1
).model_dump_json().encode()  # fmt: skip
MakeRun = Callable[..., RunRecord]


@pytest.fixture(params=["directory", pytest.param("s3", marks=[pytest.mark.slow, pytest.mark.deep])])
def service(request: pytest.FixtureRequest, settings: Settings) -> Service:
    """An empty service on each kind of store, whose bucket has something that is not ours."""
    if request.param == "s3":
        server: S3Server = request.getfixturevalue("s3_server")
        environ = server.environ()
        settings = settings.model_copy(update={"object_store": environ["ROBOMAKER_OBJECT_STORE"]})
        service = Service.open(settings, environ)
    else:
        service = Service.open(settings, {})
    service.store.ensure_bucket(BUCKET)
    for info in list(service.store.list(BUCKET)):
        service.store.delete(BUCKET, info.key)
    service.store.put_bytes(BUCKET, "nights/their.txt", b"not ours")
    return service


@pytest.fixture
def job(service: Service, tmp_path: Path) -> Callable[..., Resource]:
    """Stores a job that has ended, with its outputs."""

    def make(job_id: str, status: str = "Completed", parent: str | None = None, of: Resource | None = None) -> Resource:
        arn, run_id = service.arn("simulation-job", job_id), f"run-{job_id}"
        place = StoredPlace(bucket=BUCKET, prefix=f"nights/{job_id}/{run_id}")
        outputs = tmp_path / "outputs" / job_id
        for name, content in {"result.json": RESULT, "recording.mcap": b"x" * 1000, "logs/a.log": b"said"}.items():
            (outputs / name).parent.mkdir(parents=True, exist_ok=True)
            (outputs / name).write_bytes(content)
        publish(service.store, BUCKET, place.prefix, regular_files(outputs), about={}, created_at=service.clock())
        location = {"s3Bucket": BUCKET, "s3Prefix": "nights"}
        document = SimulationJobDocument(request={"outputLocation": location}, seed=1, run_id=run_id, outputs=place)
        if of is not None:
            taken = {"outputs": SimulationJobDocument.of(of).outputs, "reused_from": ReusedFrom(job=of.arn)}
            document = document.model_copy(update=taken)
        new = Resource.new(arn=arn, kind="simulation-job", id=job_id, status=status, parent=parent, document=document)
        service.catalog.create(new, token=None)
        return service.catalog.get(arn)

    return make


@pytest.fixture
def night(service: Service) -> MakeRun:
    """Stores a run of a specification that made, or names, some jobs."""

    def make(run_id: str, jobs: list[Resource], days: int, state: RunState = "succeeded") -> RunRecord:
        ended = service.clock() - timedelta(days=days)
        steps = [
            StepRecord(name=job.id, operation="CreateSimulationJob", status="Completed", arn=job.arn) for job in jobs
        ]
        folder = service.folder("runs", run_id)
        record = RunRecord(
            run_id=run_id, name="night", spec_path="night.yaml", state=state, exit_code=0, started_at=ended,
            ended_at=ended, steps=steps, run_dir=folder, report_path=folder / "report.html",
            jobs=[JobRecord(arn=job.arn, label=job.id, status="Completed") for job in jobs],
        )  # fmt: skip
        (folder / "run.json").write_text(record.model_dump_json())
        (folder / "report.html").write_text("a report")
        return record

    return make
