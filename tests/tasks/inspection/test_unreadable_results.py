"""A store that is away while a report is made takes no verdict with it."""

from collections.abc import Callable
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import StorageUnavailableError
from prefect_robomaker.tasks.inspection.reports import report_of_job
from prefect_robomaker.tasks.reporting.outcomes import Outcome, outcome_of
from prefect_robomaker.tasks.service.service import Service

FAILS = {"requirements": [{"name": "quick", "kind": "time_limit", "limit_s": 0.05}]}


def test_a_failed_job_stays_failed_though_its_result_cannot_be_read(
    service: Service, swing: Callable[..., dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    job = swing(job=FAILS)
    read = service.store.get_bytes

    def away(bucket: str, key: str, *more: Any) -> bytes:
        if key.endswith("result.json"):
            raise StorageUnavailableError("it does not answer")
        return read(bucket, key, *more)

    monkeypatch.setattr(service.store, "get_bytes", away)
    [reported] = report_of_job(job["arn"], service).jobs
    assert outcome_of(reported) is Outcome.FAILED
    assert reported.result is not None
    assert reported.result.notes == ["result.json cannot be read: only the verdict is known"]
