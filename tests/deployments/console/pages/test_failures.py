"""Failures by reason on the first page, and known ones apart."""

import re
from collections.abc import Callable
from html import unescape
from typing import Any

import pytest
from helpers.night_records import make_job, make_night, store_night

from prefect_robomaker.schemas.known_failures import KnownFailure
from prefect_robomaker.schemas.reports.challenge import Challenge, ChallengedJob, SabotageResult
from prefect_robomaker.schemas.reports.run_record import BEFORE_STEPS, RunRecord, StepRecord
from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.tasks.service.service import Service

KNOWN = "anna until 2027-01-15: ticket 512"


def rows(page: str) -> list[tuple[str, int]]:
    """Reason and number of jobs of each row."""
    page = page.replace("<wbr>", "")
    found = re.findall(r"<strong>([^<]*)</strong> <span class=\"unit\">(\d+) jobs?</span>", page)
    return [(reason, int(count)) for reason, count in found]


def store_known(service: Service, store_job: Callable[..., str]) -> tuple[str, str]:
    """Stores a night of which one job failed, another one as its specification knows, and returns their ids."""
    run_id = make_night("F").run_id
    ids = [store_job(verdict="FAIL", verdict_reason="gentle: 9 N", spec_run=run_id) for _ in range(2)]
    jobs = [make_job(index, "F").model_copy(update={"label": each}) for index, each in enumerate(ids)]
    jobs = [job.model_copy(update={"arn": service.arn("simulation-job", job.label)}) for job in jobs]
    noisy = Requirement(name="low_noise", satisfied=False, detail="loud")
    jobs[0] = jobs[0].model_copy(update={"requirements": [*jobs[0].requirements, noisy]})
    jobs[1] = jobs[1].model_copy(update={"known": KNOWN})
    store_night(make_night(jobs, runs=service.settings.home / "runs"))
    return ids[0], ids[1]


def test_failures_are_grouped_by_what_was_missed(browser: Any, store_job: Callable[..., str]) -> None:
    for value in (3, 4):
        store_job(verdict="FAIL", verdict_reason=f"quick: {value} s; soft: {value} N; 2 harder, 1 allowed: chair 2x")
    newest = store_job(verdict="FAIL", verdict_reason="quick: 5 s; soft: 5 N", files={"poster.png": b"p"})
    store_job("Failed", failure_code="RobotApplicationCrash", failure_reason="boom")
    store_job(verdict="PASS")
    page = browser.get("/console").text
    assert sorted(rows(page)) == [("RobotApplicationCrash", 1), ("quick, soft", 3)]
    assert "<strong>Robot<wbr>Application<wbr>Crash</strong>" in page, "it breaks at capitals where it has to"
    assert f'Newest: <a href="/console/jobs/{newest}">' in page
    assert f'src="/console/jobs/{newest}/files/poster.png"' in page
    [address] = re.findall(r'href="(/console/failures\?[^"]*)"', page)
    every = browser.get(address.replace("&amp;", "&")).text
    assert len(set(re.findall(r'href="/console/jobs/(sim-\w+)"', every))) == 3
    assert "·" not in "".join(re.findall(r'class="links">(.*?)</li>', page)), "a dot could begin a line"
    assert sorted(rows(browser.get("/console/failures").text)) == sorted(rows(page))


def test_specifications_stand_apart_the_one_that_failed_last_first(browser: Any, store_job: Callable[..., str]) -> None:
    for name in ("alone", "nightly", "Nightly", "zoo", "house"):
        store_job(verdict="FAIL", verdict_reason="quick: 5 s", spec_run=f"{name}-20260301T020000000")
    page = browser.get("/console/failures").text
    assert re.findall(r'class="of-spec">([^<]*)<', page) == ["house", "zoo", "Nightly", "nightly", "alone"]


def test_known_failures_stand_apart(browser: Any, service: Service, store_job: Callable[..., str]) -> None:
    failed, known = store_known(service, store_job)
    red, _, apart = browser.get("/console").text.partition('id="known-failures"')
    assert ">nightly</h3>" in red
    assert rows(red) == [("gentle, low noise", 1)], "in the words of the report's table"
    assert failed in red
    assert known not in red.partition('id="failures"')[2]
    assert rows(apart.partition("</section>")[0]) == [("gentle", 1)]
    assert KNOWN in apart
    assert "badge failed" not in apart.partition("</section>")[0]


def test_a_job_with_trials_is_grouped_by_what_its_trials_missed(
    browser: Any, service: Service, store_job: Callable[..., str]
) -> None:
    run_id = make_night("F").run_id
    ids = [store_job(verdict="FAIL", verdict_reason="trials: 3 of 8 did not pass", spec_run=run_id) for _ in range(3)]
    told = Requirement(name="trials", satisfied=False, detail="3 of 8 trials did not pass")
    counts = {"counts": False, "detail": "met in 5 of 8 trials"}
    off = Requirement(name="rooms", kind="off", satisfied=False, **counts)
    missed = [
        [
            Requirement(name=name, kind="no_collision", satisfied=name not in wrong, **counts)
            for name in ("soft", "quick")
        ]
        for wrong in (["soft"], ["soft", "quick"], [])
    ]
    jobs = [
        make_job(index, "F").model_copy(
            update={"label": each, "arn": service.arn("simulation-job", each), "requirements": [told, off, *own]}
        )
        for index, (each, own) in enumerate(zip(ids, missed, strict=True))
    ]
    store_night(make_night(jobs, runs=service.settings.home / "runs"))
    assert sorted(rows(browser.get("/console").text)) == [("soft", 1), ("soft, quick", 1), ("trials did not pass", 1)]


def test_jobs_have_the_names_that_their_run_gave_them(
    browser: Any, service: Service, store_job: Callable[..., str]
) -> None:
    run_id = make_night("F").run_id
    job = store_job(verdict="FAIL", robot_application_names=["scout"], world_name="flat 3", spec_run=run_id)
    record = make_job(0, "F").model_copy(
        update={"label": job, "arn": service.arn("simulation-job", job), "name": "scout in flat 3, seed=4"}
    )
    store_night(make_night([record], runs=service.settings.home / "runs"))
    newest = f'Newest: <a href="/console/jobs/{job}">scout in flat 3, seed=4</a>'

    assert newest in browser.get("/console").text
    assert newest in browser.get("/console/failures").text
    page = browser.get(f"/console/jobs/{job}").text
    assert "<h1>scout in flat 3, seed=4</h1>" in page
    assert "<title>scout in flat 3, seed=4" in page


def test_the_page_of_a_run_and_of_a_job_says_what_is_known(
    browser: Any, service: Service, store_job: Callable[..., str]
) -> None:
    failed, known = store_known(service, store_job)
    run_id = make_night("F").run_id
    others, _, apart = browser.get(f"/console/runs/{run_id}").text.partition('id="known-title"')
    assert "1 failure known" in others
    assert failed in others
    assert known not in others
    assert known in apart
    assert KNOWN in apart
    assert "badge failed" not in apart


def test_jobs_that_no_run_has_say_what_they_are(browser: Any, store_job: Callable[..., str]) -> None:
    store_job(verdict="FAIL", verdict_reason="trials: 2 of 4 trials did not pass: 1 and 3")
    page = browser.get("/console").text
    assert ">Ordered without a specification</h3>" in page
    assert "An SDK or another program ordered these jobs, so they belong to no run." in page
    assert rows(page) == [("trials did not pass", 1)]


def test_the_first_page_says_what_needs_somebody_now(
    browser: Any, service: Service, store_job: Callable[..., str]
) -> None:
    """Failures that the newest run does not have are listed below, so that the first page is not red with old runs."""
    runs = service.settings.home / "runs"
    for night, letter in enumerate("FP"):
        run_id = make_night(letter, night).run_id
        job = store_job(verdict="FAIL" if letter == "F" else "PASS", verdict_reason="gentle: 9 N", spec_run=run_id)
        record = make_job(0, letter, night=night).model_copy(
            update={"label": job, "arn": service.arn("simulation-job", job)}
        )
        store_night(make_night([record], night, runs=runs))
    page = browser.get("/console").text
    now, _, past = page.partition('id="past-failures"')
    assert rows(now) == []
    assert "The newest runs have no failures" in now
    assert rows(past) == [("gentle", 1)]
    assert "Since the run before: 1 job newly passing." in page
    newest, before = (make_night("P", night).run_id for night in (1, 0))
    assert f'href="/console/runs/{newest}#since-title"' in page
    assert f'href="/console/compare?before={before}&amp;after={newest}"' in page


def test_a_batch_looks_as_its_run_does_and_has_its_name(
    browser: Any, service: Service, store_job: Callable[..., str], store_batch: Callable[..., str]
) -> None:
    night = make_night("F")
    batch = store_batch(1, status="Completed", verdicts={"FAIL": 1}, spec_run=night.run_id)
    job = store_job(verdict="FAIL", batch=batch, request_index=0, spec_run=night.run_id)
    record = make_job(0, "F").model_copy(update={"label": job, "arn": service.arn("simulation-job", job)})
    pages = ("/console/batches", f"/console/batches/{batch.rpartition('/')[2]}")
    step = StepRecord(name="drive", operation="StartSimulationJobBatch", status="Completed", arn=batch)
    run = make_night([record], runs=service.settings.home / "runs").model_copy(update={"steps": [step]})
    path = store_night(run)
    for known in ("", KNOWN):
        told = run.model_copy(update={"jobs": [record.model_copy(update={"known": known})]})
        (path / "run.json").write_text(told.model_dump_json())
        for page in (browser.get(path).text for path in pages):
            assert ("badge failed" in page) == (not known)
            assert ("</svg>succeeded</span>" in page) == bool(known)
            assert "drive of nightly" in page
    tile = browser.get(pages[1]).text.partition('class="strip"')[2]
    assert 'class="tile known"' in tile
    assert "badge failed" not in browser.get(f"/console/jobs/{job}").text
    assert "badge failed" not in browser.get("/console/jobs").text


def test_a_batch_and_a_run_whose_jobs_all_passed_say_passed(
    browser: Any, service: Service, store_job: Callable[..., str], store_batch: Callable[..., str]
) -> None:
    night = make_night("P", runs=service.settings.home / "runs")
    batch = store_batch(1, status="Completed", verdicts={"PASS": 1}, spec_run=night.run_id)
    store_job(verdict="PASS", batch=batch, request_index=0, spec_run=night.run_id)
    store_night(night)
    pages = ("batches", f"batches/{batch.rpartition('/')[2]}", "runs", f"runs/{night.run_id}")
    for page in (browser.get(f"/console/{each}").text for each in pages):
        assert "</svg>passed</span>" in page
        assert "</svg>succeeded</span>" not in page


REASON = "there is no robot application 'my-robot' (broken.yaml:11:45)"


def refused_night(service: Service, night: int) -> RunRecord:
    """Stores a night that was refused before its first step."""
    steps = [
        StepRecord(name=BEFORE_STEPS, operation="RunPipeline", status="Failed", error=REASON),
        StepRecord(name="drive", operation="CreateSimulationJob", status="Skipped"),
    ]
    record = make_night("", night, runs=service.settings.home / "runs").model_copy(
        update={"state": "broken", "steps": steps, "command": ["prefect", "deployment", "run", "RunPipeline/nightly"]}
    )
    store_night(record)
    return record


def test_a_refused_night_needs_somebody_until_a_later_one_is_not_refused(browser: Any, service: Service) -> None:
    runs = service.settings.home / "runs"
    store_night(make_night("P", runs=runs))
    refused = refused_night(service, 1)
    store_night(make_night("P", 2, runs=runs).model_copy(update={"probe": True}))
    for path in ("/console", "/console/failures"):
        page = unescape(browser.get(path).text)
        assert f'href="/console/runs/{refused.run_id}">nightly</a>' in page
        assert f'class="reason">refused before its first step: {REASON}</span>' in page
        assert "None of the newest jobs failed" not in page

    store_night(make_night("P", 3, runs=runs))

    assert "refused before" not in browser.get("/console/failures").text
    assert "None of the newest jobs failed" in browser.get("/console").text


FAILED_EXPORT = [StepRecord(name="export", operation="CreateWorldExportJob", status="Failed", error="no world is left")]
UNNOTICED = Challenge(
    sabotages=[SabotageResult(name="deaf", axes={}, missed=3), SabotageResult(name="blind", axes={}, caught=3)],
    jobs=[ChallengedJob(name="drive", control="passes")],
)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"state": "broken", "steps": FAILED_EXPORT}, "step export: no world is left"),
        ({"state": "timed out"}, "ran out of time: 1 of 1 job passed"),
        (
            {"state": "failed", "probe": True, "challenge": UNNOTICED},
            "challenge: 1 of 2 sabotages caught; unnoticed: deaf",
        ),
    ],
    ids=["step", "time", "challenge"],
)
def test_a_run_that_is_wrong_without_a_failed_job_needs_somebody(
    browser: Any, service: Service, changed: dict[str, Any], told: str
) -> None:
    runs = service.settings.home / "runs"
    store_night(make_night("P", 1, runs=runs).model_copy(update=changed))
    page = browser.get("/console").text
    assert f'class="reason">{told}</span>' in page
    assert "None of the newest jobs failed" not in page

    well = {"probe": True, "challenge": UNNOTICED.model_copy(update={"sabotages": UNNOTICED.sabotages[1:]})}
    store_night(make_night("P", 2, runs=runs).model_copy(update=well if "challenge" in changed else {}))
    assert told not in browser.get("/console").text


def test_a_group_has_its_page_while_another_specification_is_refused(
    browser: Any, service: Service, store_job: Callable[..., str]
) -> None:
    refused_night(service, 1)
    store_job(verdict="FAIL", verdict_reason="gentle: 9 N", spec_run="other-20260301T020000000")
    page = browser.get("/console/failures?specification=other&reason=gentle")
    assert (page.status_code, "<h1>gentle</h1>" in page.text) == (200, True)


def test_a_known_failure_whose_day_is_over_and_that_failed_again_is_not_to_be_removed(
    browser: Any, service: Service, store_job: Callable[..., str]
) -> None:
    known = KnownFailure.model_validate({"match": {"requirement": "gentle"}, "owner": "anna", "until": "2026-03-01"})
    runs = service.settings.home / "runs"
    for night in range(2):
        run_id = make_night("F", night).run_id
        label = store_job(verdict="FAIL", verdict_reason="gentle: 9 N", spec_run=run_id)
        job = make_job(0, "F", night=night).model_copy(
            update={
                "label": label,
                "arn": service.arn("simulation-job", label),
                "known": "" if night else str(known),
                "requirements": [Requirement(name="gentle", kind="no_collision", satisfied=False, detail="9 N")],
            }
        )
        store_night(make_night([job], night, runs=runs).model_copy(update={"known": [known]}))
    page = browser.get("/console").text
    assert str(known) in page
    assert "remove it from" not in page


def test_the_page_of_a_refused_run_begins_with_the_reason(browser: Any, service: Service) -> None:
    refused = refused_night(service, 1)
    page = unescape(browser.get(f"/console/runs/{refused.run_id}").text)
    assert f"<strong>Refused before its first step: {REASON}</strong>" in page
    assert not [each for each in ("2 steps", "1 step", ", took", "has results") if each in page]
    assert "<code>prefect deployment run RunPipeline/nightly</code>" in page, "`robomaker rerun` could only fail"
    assert "robomaker rerun" not in page


def test_a_known_failure_that_the_newest_run_does_not_have_is_said_to_be_over(
    browser: Any, service: Service, store_job: Callable[..., str]
) -> None:
    known = KnownFailure.model_validate(
        {"match": {"requirement": "gentle"}, "owner": "anna", "until": "2027-01-15", "why": "ticket 512"}
    )
    runs = service.settings.home / "runs"
    for night, letter in enumerate("FP"):
        run_id = make_night("P", night).run_id
        verdict = {"F": "FAIL", "P": "PASS"}[letter]
        label = store_job(verdict=verdict, verdict_reason="gentle: 9 N", spec_run=run_id)
        job = make_job(0, letter, night=night).model_copy(
            update={
                "label": label,
                "arn": service.arn("simulation-job", label),
                "known": KNOWN if letter == "F" else "",
            }
        )
        store_night(make_night([job], night, runs=runs).model_copy(update={"known": [known]}))
        before, _, past = browser.get("/console").text.partition('id="past-failures"')
        assert ('id="known-failures"' in before) == (letter == "F")
        assert (f"{KNOWN}; did not occur in the newest run; remove it from `known`" in past) == (letter == "P")


def test_sabotaged_jobs_of_a_challenge_are_no_failures(browser: Any, store_job: Callable[..., str]) -> None:
    """They have to fail; its jobs without a sabotage have not, and a tag of that name may be somebody's own."""
    missed = {"verdict": "FAIL", "verdict_reason": "quick: 5 s", "spec_run": "chal-challenge-20260301T020000000"}
    store_job(**missed, tags={"sabotage": "idle", "challenged-job": "1"})
    assert rows(browser.get("/console").text) == rows(browser.get("/console/failures").text) == []
    store_job(**missed, tags={"challenged-job": "1"})
    store_job(**missed, tags={"sabotage": "of mine"})
    assert rows(browser.get("/console").text) == [("quick", 2)]
