"""Pages of batches: rates, failures, refused requests, and where the time went."""

import re
from collections.abc import Callable
from typing import Any

from prefect_robomaker.schemas.documents.simulation_jobs import FailedRequest

StoreJob = Callable[..., str]
StoreBatch = Callable[..., str]


def id_of(arn: str) -> str:
    return arn.rpartition("/")[2]


def test_a_batch_shows_its_rate_and_its_failures(browser: Any, store_job: StoreJob, store_batch: StoreBatch) -> None:
    batch = store_batch(6)
    for index in range(3):
        store_job(batch=batch, request_index=index, verdict="PASS")
    store_job("Failed", batch=batch, request_index=3, failure_code="RobotApplicationCrash", failure_reason="boom")
    failed = store_job(batch=batch, request_index=4, verdict="FAIL", verdict_reason="late", files={"poster.png": b"p"})
    page = browser.get(f"/console/batches/{id_of(batch)}").text

    assert "3 of 4 that were judged" in page
    assert "95&nbsp;% interval 30 to 95&nbsp;%" in page
    assert "5 of 6 jobs ended" in page
    assert "RobotApplicationCrash: boom" in page
    assert f'src="/console/jobs/{failed}/files/poster.png"' in page
    assert "request 6: waiting" in page


def test_a_batch_shows_the_requests_that_were_refused(
    browser: Any, store_job: StoreJob, store_batch: StoreBatch
) -> None:
    """No job was made of them, so none failed; the page said that no job had failed, and nothing more."""
    refused = FailedRequest(
        failure_code="LimitExceeded", failure_reason="too <much>", failed_at="2026-11-28T23:00:00+00:00"
    )
    batch = store_batch(2, "Failed", failed={"1": refused})
    store_job(batch=batch, request_index=0, verdict="PASS")

    page = browser.get(f"/console/batches/{id_of(batch)}").text

    assert "No job failed" not in page
    assert "Refused requests" in page
    assert "request 2" in page
    assert "LimitExceeded: too &lt;much&gt;" in page
    assert "No job failed" in browser.get(f"/console/batches/{id_of(store_batch(1))}").text

    late = refused.model_copy(update={"failure_code": "BatchCanceled"})
    canceled = browser.get(f"/console/batches/{id_of(store_batch(1, 'Canceled', failed={'0': late}))}").text
    assert "Refused requests" not in canceled, "nobody refused what had not begun"


def test_a_batch_shows_which_jobs_only_draw_or_store_and_where_the_time_went(
    browser: Any, store_job: StoreJob, store_batch: StoreBatch
) -> None:
    batch, ended = store_batch(4), "2026-11-28T23:00:00+00:00"
    done = {"simulationTimeMillis": 8000, "videoS": 4.0, "uploadS": 1.5, "waitedS": {"memory": 3.0}}
    shown = store_job(verdict="FAIL", batch=batch, requestIndex=0, **done)
    for index, (status, since) in enumerate((("Running", None), ("Running", ended), ("Terminating", ended)), 1):
        store_job(status, batch=batch, requestIndex=index, simulatedAt=since)
    page = browser.get(f"/console/batches/{id_of(batch)}").text
    words = "waiting 3.0 s, simulation 8.0 s, videos of failures 4.0 s, uploads 1.5 s"
    assert f"Where the time went, all jobs together: {words}" in page
    looks = re.findall(r"</svg>(?:<span>)?(running|drawing|storing)", page.partition('class="grid')[0])
    assert looks == ["running", "running", "drawing", "storing"]  # the batch, then its jobs
    assert "1 of 4 jobs ended" in page
    assert f"Where the time went: {words}" in browser.get(f"/console/jobs/{shown}").text
    filmed = store_job(verdict="FAIL", request={"tags": {"robomaker:video": "always"}}, **done)
    assert (
        "simulation with its videos 8.0 s, last seconds of failures 4.0 s"
        in browser.get(f"/console/jobs/{filmed}").text
    )
