"""Flow runs of job workers that a work pool starts, in this process."""

from prefect_robomaker.flows.pool_job_workers import RunJobWorker
from prefect_robomaker.tasks.service.service import Service


def test_a_machine_with_another_catalog_ends_as_misconfigured(service: Service, prefect_server: str) -> None:
    batch = "arn:aws:robomaker:us-east-1:000000000000:simulation-job-batch/batch-of-others"
    with service.activated():
        ended = RunJobWorker(batch, return_state=True)

    assert (ended.type.value, ended.name) == ("FAILED", "Misconfigured")
    assert f"the catalog of this machine, {service.settings.catalog_url}, does not have" in (ended.message or "")
