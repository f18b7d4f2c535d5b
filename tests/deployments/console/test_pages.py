"""What pages show of what is stored."""

import json
import re
from collections.abc import Callable
from datetime import timedelta
from typing import Any

import pytest
from helpers.night_records import make_job, make_night, store_night
from helpers.planted_causes import draw, planted

from prefect_robomaker.deployments.console.rendering import address
from prefect_robomaker.deployments.console.sessions import Sessions
from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.reports.challenge import Challenge, ChallengedJob, SabotageResult
from prefect_robomaker.schemas.reports.live_comparison import AgainstAnswer
from prefect_robomaker.schemas.reports.names import name_label
from prefect_robomaker.schemas.reports.run_record import Order, RerunOf
from prefect_robomaker.schemas.wire.errors import ServiceUnavailableException
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.causes.explanation import explain
from prefect_robomaker.tasks.causes.stored import write_why
from prefect_robomaker.tasks.nights.open_runs import OpenRun
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

StoreJob = Callable[..., str]
StoreBatch = Callable[..., str]
BATCH = "simulation-job-batch"


def id_of(arn: str) -> str:
    return arn.rpartition("/")[2]


def in_turn(find: Callable[..., Any], times: int) -> Callable[..., Any]:
    """Sessions that are over when they have been asked for some times."""
    left = iter(range(times))

    def found(sessions: Sessions, token: str | None) -> Any:
        return None if next(left, None) is None else find(sessions, token)

    return found


def events(stream: str) -> list[tuple[str, object]]:
    """The events of a stream that has ended."""
    found = [part.split("\n") for part in stream.split("\n\n") if part.startswith("event: ")]
    return [(name.removeprefix("event: "), json.loads(data.removeprefix("data: "))) for name, data in found]


def test_a_jobs_axes_are_shown_as_they_were_written(browser: Any, store_job: StoreJob) -> None:
    job = store_job(verdict="PASS", tags={"robomaker:axis:stop": "=30.5", "team": "red"})
    for path in (f"/console/jobs/{job}", "/console/jobs"):
        page = browser.get(path).text
        assert re.findall(r'<a class="tag" href="([^"]*)">([^<]*)</a>', page) == [
            ("/console/jobs?tag=robomaker%3Aaxis%3Astop%3D%3D30.5", "stop = 0.5"),
            ("/console/jobs?tag=team%3Dred", "team=red"),
        ]
    assert job in browser.get("/console/jobs?tag=robomaker%3Aaxis%3Astop%3D%3D30.5").text


def test_a_world_that_is_the_value_of_an_axis_has_its_name(browser: Any, store_job: StoreJob, service: Service) -> None:
    world_id = "generation-82856b0yq33y/world-1"
    there, gone = service.arn("world", world_id), service.arn("world", "generation-82856b0yq33y/world-2")
    document = {"templateName": "flat", "bundle": {"bucket": "b", "prefix": "worlds/1"}}
    service.catalog.create(Resource.new(arn=there, kind="world", id=world_id, document=document), token=None)
    store_job(verdict="PASS", tags={"robomaker:axis:world": there})
    store_job(verdict="PASS", tags={"robomaker:axis:world": gone})

    page = browser.get("/console/jobs").text
    assert "world = flat 1 (generation-82856b0yq33y/world-1)</a>" in page
    assert "world = generation-82856b0yq33y/world-2</a>" in page
    assert "world = arn:" not in page


def test_the_first_page_shows_what_runs_and_what_failed(
    browser: Any, store_job: StoreJob, store_batch: StoreBatch
) -> None:
    assert "Nothing runs now." in browser.get("/console").text
    batch = store_batch(3)
    store_job(batch=batch, verdict="PASS")
    failed = store_job(batch=batch, request_index=1, verdict="FAIL", verdict_reason="drives: 2 m of 9 m")
    page = browser.get("/console").text

    assert id_of(batch) in page
    assert "2 of 3 jobs ended" in page
    assert f'href="/console/jobs/{failed}"' in page
    assert "drives: 2 m of 9 m" in page


def test_a_run_that_goes_on_is_shown_before_it_has_jobs(browser: Any, service: Service) -> None:
    run_id = "nightly-20260301T020000000"
    folder = service.settings.home / "runs" / run_id
    folder.mkdir(parents=True)
    order = Order(run_id=run_id, text="", filename="", spec_path="", command=["true"])
    run = OpenRun.begin(folder, order)
    try:
        page = browser.get("/console").text
        assert f'href="/console/runs/{run_id}"' in page
        assert "<strong>nightly</strong>" in page
        assert "Nothing runs now." not in page
        assert "It has none yet." in browser.get(f"/console/runs/{run_id}").text
    finally:
        run.end()
    assert "Nothing runs now." in browser.get("/console").text


def test_a_run_is_compared_with_nights_of_its_specification_only(browser: Any, service: Service) -> None:
    runs = service.settings.home / "runs"
    first, shown, last = (make_night("PF", night, runs=runs) for night in (0, 2, 6))
    rerun = make_night("P", 1, runs=runs).model_copy(
        update={"rerun_of": RerunOf(run_id=first.run_id, selection="failed", jobs_total=2, earlier={})}
    )
    challenge = make_night("PF", 3, runs=runs).model_copy(update={"probe": True, "challenge": Challenge(sabotages=[])})
    refused = make_night("", 5, runs=runs).model_copy(update={"state": "broken"})
    for record in (first, shown, last, rerun, challenge, refused, make_night("P", 4, name="nightly-flats", runs=runs)):
        store_night(record)

    page = browser.get(f"/console/runs/{shown.run_id}").text

    assert re.findall(r'<option value="([^"]*)"( selected)?>', page) == [(last.run_id, ""), (first.run_id, " selected")]
    assert f">2026-03-07 02:00, 1 of 2 jobs passed ({last.run_id})<" in page


def test_a_job_that_never_ran_prints_no_command_that_repeats_it(browser: Any, store_job: StoreJob) -> None:
    never, ran = store_job("Canceled"), store_job(verdict="FAIL", files={"provenance.json": b"{}"})
    assert f"robomaker repro {ran}" in browser.get(f"/console/jobs/{ran}").text
    page = browser.get(f"/console/jobs/{never}").text
    assert "robomaker repro" not in page
    assert "It ended before it ran: there is nothing to repeat." in page


def test_a_job_that_broke_shows_its_logs_and_the_commands_that_repeat_it(
    browser: Any, store_job: StoreJob, service: Service
) -> None:
    """Outputs of a run that broke are stored without a manifest."""
    files = {"provenance.json": b"{}", "logs/robot.stdout.log": b"motor driver lost\n"}
    job = store_job("Failed", files=files)
    place = SimulationJobDocument.of(service.catalog.get(service.arn("simulation-job", job))).outputs
    assert place is not None
    service.store.delete(place.bucket, f"{place.prefix}/manifest.json")

    page = browser.get(f"/console/jobs/{job}").text

    assert "motor driver lost" in page
    assert f"robomaker repro {job}" in page
    assert browser.get(f"/console/jobs/{job}/files/logs/robot.stdout.log").text == "motor driver lost\n"
    assert browser.get(f"/console/jobs/{job}/files/../{job}/provenance.json").status_code == 404


def test_what_changes_of_a_batch_is_sent_until_it_ends(
    browser: Any, store_job: StoreJob, store_batch: StoreBatch
) -> None:
    batch = store_batch(2, status="Completed")
    job = store_job(batch=batch, verdict="PASS")
    answer = browser.get(f"/console/batches/{id_of(batch)}/live")
    sent = dict(events(answer.text))

    assert answer.headers["content-type"].startswith("text/event-stream")
    assert set(sent) == {"tiles", "parts", "end"}
    assert job in sent["tiles"]["tile-1"]  # type: ignore[index]
    assert set(sent["parts"]) == {"batch-acts", "batch-head", "failures"}  # type: ignore[call-overload]
    assert "/cancel" not in sent["parts"]["batch-acts"]  # type: ignore[index]


def test_lists_go_on_page_by_page(browser: Any, store_job: StoreJob) -> None:
    jobs = {store_job(verdict="PASS", tags={"team": "red"}) for _ in range(60)}
    for path in ("/console/jobs", "/console/jobs?tag=team%3Dred", "/console/jobs?status=Completed"):
        first = browser.get(path).text
        [link] = [part.partition('"')[0] for part in first.split('rel="next" href="')[1:]]
        second = browser.get(link.replace("&amp;", "&")).text
        shown = [{job for job in jobs if job in page} for page in (first, second)]

        assert [len(each) for each in shown] == [50, 10], path
        assert shown[0] | shown[1] == jobs
        assert 'rel="next"' not in second
    assert "No such jobs." in browser.get("/console/jobs?tag=team%3Dblue").text


def test_a_job_that_ended_shows_its_files_and_logs(browser: Any, store_job: StoreJob) -> None:
    files = {"logs/stdout.log": b"\x1b[31mhello\x1b[0m <b>", "video.mp4": b"film", "page.html": b"<script>"}
    files["provenance.json"] = b"{}"
    job = store_job("Failed", files=files, failure_code="Internal", failure_reason="boom")
    page = browser.get(f"/console/jobs/{job}").text

    assert "hello &lt;b&gt;" in page
    assert f'<video controls preload="metadata" src="/console/jobs/{job}/files/video.mp4"' in page
    assert f"robomaker repro {job}" in page
    assert f"robomaker verify {job}" in page


def test_a_log_is_followed_while_the_job_runs(
    browser: Any, store_job: StoreJob, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = store_job("Running", run_id="run-1")
    logs = service.folder("jobs", job, "run-1", "output", "logs")
    (logs / "stdout.log").write_text("first line\n")
    (logs / "stderr.log").symlink_to("/etc/passwd")
    arn = service.arn("simulation-job", job)
    read = service.catalog.get
    looks = iter(("Running", "Running"))

    def get(*words: str, **more: str) -> object:
        if next(looks, None) is None:  # at the third look it has ended
            with (logs / "stdout.log").open("a") as log:
                log.write("last line\n")
            service.catalog.transition(arn, "terminate")
            service.catalog.transition(arn, "complete")
        return read(*words, **more)

    monkeypatch.setattr(service.catalog, "get", get)
    sent = events(browser.get(f"/console/jobs/{job}/live").text)

    assert [data for name, data in sent if name == "log"] == ["— logs/stdout.log —\nfirst line\n", "last line\n"]
    assert [name for name, _ in sent][-2:] == ["reload", "end"]
    assert "root:" not in str(sent)


def test_a_folder_of_logs_that_is_a_link_is_not_followed(
    browser: Any, store_job: StoreJob, service: Service, tmp_path: Any
) -> None:
    (tmp_path / "others").mkdir()
    (tmp_path / "others" / "diary.log").write_text("private")
    job = store_job(run_id="run-1")
    (service.folder("jobs", job, "run-1", "output") / "logs").symlink_to(tmp_path / "others")
    assert "private" not in browser.get(f"/console/jobs/{job}/live").text


def test_who_logs_out_follows_nothing_any_more(
    visitor: Any, store_job: StoreJob, store_batch: StoreBatch, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = AccessKey("AKID", "word", "alice")
    browser, batch = visitor(key), store_batch(2)
    browser.post("/console/login", data={"key": key.id, "secret": key.secret})
    monkeypatch.setattr(Sessions, "find", in_turn(Sessions.find, 3))
    sent = events(browser.get(f"/console/batches/{id_of(batch)}/live").text)
    assert sent[-1] == ("end", None)


def test_a_generation_that_has_made_nothing_yet_is_shown(browser: Any, template: str, service: Service) -> None:
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 2}
    asked = {"template": template, "worldCount": count}
    generation = id_of(call("CreateWorldGenerationJob", asked, service)["arn"])
    shown = browser.get(f"/console/generations/{generation}")
    assert (shown.status_code, generation in shown.text) == (200, True)


@pytest.mark.parametrize(
    ("path", "status"),
    [(f"/runs/{'a' * 300}", 404), (f"/search?q={'a' * 300}", 404), ("/jobs?tag=a%22b=c", 200)],
    ids=["a long name", "a long search", "a tag with a quotation mark"],
)
def test_odd_questions_have_answers(browser: Any, path: str, status: int) -> None:
    assert browser.get(f"/console{path}").status_code == status


def test_files_have_types_that_run_nothing(browser: Any, store_job: StoreJob) -> None:
    files = {"a.html": b"<script>", "a.svg": b"<svg>", "a.json": b"{}", "video.mp4": b"0123456789", "a.mcap": b"m"}
    job = store_job(files=files)
    types = {}
    for name in files:
        answer = browser.get(f"/console/jobs/{job}/files/{name}")
        types[name] = (answer.headers["content-type"], answer.headers["content-disposition"].partition(";")[0])
        assert answer.content == files[name]
        assert answer.headers["content-security-policy"].startswith("sandbox;")

    assert types == {
        "a.html": ("application/octet-stream", "attachment"),
        "a.svg": ("application/octet-stream", "attachment"),
        "a.json": ("text/plain; charset=utf-8", "inline"),
        "video.mp4": ("video/mp4", "inline"),
        "a.mcap": ("application/octet-stream", "attachment"),
    }
    part = browser.get(f"/console/jobs/{job}/files/video.mp4", headers={"range": "bytes=2-4"})
    assert (part.status_code, part.content) == (206, b"234")
    for name in ("manifest.json", "%2e%2e/x", "..%2fmanifest.json", "nothing"):
        assert browser.get(f"/console/jobs/{job}/files/{name}").status_code == 404


@pytest.mark.parametrize("part", ["bytes=2-4", "bytes=99-", "nonsense"])
def test_a_copy_from_a_store_elsewhere_goes_when_it_was_sent(
    browser: Any, store_job: StoreJob, service: Service, monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    job = store_job(files={"video.mp4": b"0123456789"})
    monkeypatch.setattr(type(service.store), "local_path", lambda *_: None)
    answer = browser.get(f"/console/jobs/{job}/files/video.mp4", headers={"range": part})
    assert answer.status_code == {"bytes=2-4": 206, "bytes=99-": 416}.get(part, 400)
    assert list(service.folder("scratch").glob("console-*")) == []


def test_a_template_shows_its_body_and_what_it_made(browser: Any, template: str, service: Service) -> None:
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 2}
    asked = {"template": template, "worldCount": count, "worldTags": {"team": "red"}}
    job = call("CreateWorldGenerationJob", asked, service)["arn"]
    world = Resource.new(
        arn=f"{service.arn('world', id_of(job))}/world-1",
        kind="world",
        id=f"{id_of(job)}/world-1",
        parent=job,
        tags={"team": "red"},
        labels={"templateId": [id_of(template)]},
        document={"template": template},
    )
    service.catalog.create(world, token=None)
    page = browser.get(f"/console/worlds?template={id_of(template)}").text
    assert "&#34;Buildings&#34;" in page
    assert f"/console/generations/{id_of(job)}" in page
    assert world.id in page
    plain = browser.get("/console/worlds")
    assert (plain.status_code, "Its body" in plain.text, world.id in plain.text) == (200, False, True)
    for tag, is_there in (("team=red", True), ("team=blue", False)):
        page = browser.get(f"/console/worlds?template={id_of(template)}&tag={tag}").text
        assert (world.id in page, f"/console/batches?tag={tag.replace('=', '%3D')}" in page) == (is_there, True)
    found = browser.get(f"/console/search?q={id_of(template)}")
    assert found.headers["location"] == f"/console/worlds?template={id_of(template)}"


def test_jobs_are_shown_by_name_and_the_search_finds_them_so(
    browser: Any, store_job: StoreJob, service: Service
) -> None:
    named = {"robot_application_names": ["scout"], "simulation_application_names": ["room"], "world_name": "flat 3"}
    job = store_job(verdict="FAIL", **named)
    for path in ("/jobs", f"/jobs/{job}", ""):
        page = browser.get(f"/console{path}").text
        assert "scout in flat 3" in page, path
        assert job in page, path
    unnamed = store_job()
    assert f">{unnamed}</a>" in browser.get("/console/jobs").text
    for wanted in (job[:-2], job.removeprefix("sim-")[:6]):
        page = browser.get(f"/console/search?q={wanted}").text
        found = browser.get(f"/console/search?q={wanted}").headers.get("location", page)
        assert found == f"/console/jobs/{job}", wanted


def test_worlds_of_one_name_are_told_apart_and_an_old_body_is_told(
    browser: Any, template: str, service: Service
) -> None:
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    jobs = [call("CreateWorldGenerationJob", {"template": template, "worldCount": count}, service)["arn"] for _ in "12"]
    for job in jobs:
        world_id = f"{id_of(job)}/world-1"
        world = Resource.new(
            arn=service.arn("world", world_id),
            kind="world",
            id=world_id,
            parent=job,
            labels=name_label("two rooms 1"),
            document={
                "template": template,
                "templateName": "two rooms",
                "bundle": {"bucket": "b", "prefix": f"worlds/{id_of(job)}"},
            },
        )
        service.catalog.create(world, token=None)
    page = browser.get("/console/worlds").text
    for job in jobs:
        own = re.findall(rf'<li class="card">(?:(?!</li>).)*{id_of(job)}/world-1</span>', page, re.DOTALL)
        assert "<strong>two rooms 1</strong>" in own[0], "the id beside it tells it apart"
    both = browser.get("/console/search?q=two+rooms+1").text
    assert all(f"{id_of(job)}/world-1" in both for job in jobs)


def test_the_search_leads_to_pages(browser: Any, store_job: StoreJob, template: str, service: Service) -> None:
    job, scout = store_job(), service.catalog.find("robot-application", "scout")
    assert scout is not None
    for wanted, place in (
        (job, f"/console/jobs/{job}"),
        ("team=red", "/console/jobs?tag=team%3Dred"),
        ("two rooms", f"/console/worlds?template={id_of(template)}"),
        ("scout", address(scout.kind, scout.id)),
    ):
        assert browser.get("/console/search", params={"q": wanted}).headers["location"] == place
    assert browser.get("/console/search", params={"q": "nothing"}).status_code == 404


def test_built_in_applications_are_listed_as_what_they_are(browser: Any, service: Service) -> None:
    robot = {"name": "rover", "robotSoftwareSuite": {"name": "General"}, "environment": {"uri": "python://rover"}}
    call("CreateRobotApplication", robot, service)
    rows = re.findall(r"<tr><th scope=\"row\">.*?</tr>", browser.get("/console/applications").text)
    come_along = {re.sub("<[^>]*>", "", row.partition("</th>")[0]): "comes with this package" in row for row in rows}

    assert come_along == {
        "rover": False, "scout": True, "walker": True, "indoor-navigation": True, "recorded-run": True
    }  # fmt: skip


def test_a_job_of_its_own_is_shown_however_many_jobs_batches_run(
    browser: Any, store_job: StoreJob, store_batch: StoreBatch
) -> None:
    alone, batch = store_job("Running"), store_batch(20)
    inside = [store_job("Running", batch=batch, request_index=index) for index in range(20)]
    page = browser.get("/console").text

    assert f"/console/jobs/{alone}" in page
    assert not [job for job in inside if job in page]


def test_a_change_that_others_see_late_is_not_missed(
    browser: Any, store_job: StoreJob, store_batch: StoreBatch, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("prefect_robomaker.deployments.console.batches._EVERY_S", 0.01)
    batch = store_batch(2)
    store_job(batch=batch, verdict="PASS")
    read, now, late = service.catalog.child_revisions, service.clock(), []

    def after_a_slow_commit(*words: Any) -> Any:
        found = read(*words)
        if not late:  # its time is from before what was just seen
            monkeypatch.setattr(service.catalog, "_clock", lambda: now - timedelta(seconds=10))
            late.append(store_job(batch=batch, request_index=1, verdict="FAIL", verdict_reason="late"))
        elif len(late) == 1:
            late.append("")
            service.catalog.transition(batch, "drain")
            service.catalog.transition(batch, "complete")
        return found

    monkeypatch.setattr(service.catalog, "child_revisions", after_a_slow_commit)
    sent = events(browser.get(f"/console/batches/{id_of(batch)}/live").text)
    tiles = [data for name, data in sent if name == "tiles"]

    assert late[0] in str(tiles)


def test_filters_of_batches_go_on_with_older_ones(browser: Any, store_batch: StoreBatch) -> None:
    for _ in range(21):
        store_batch(1, status="Completed", tags={"team": "red"})
    page = browser.get("/console/batches?status=Completed&tag=team%3Dred").text
    [link] = [part.partition('"')[0] for part in page.split('rel="next" href="')[1:]]

    assert "status=Completed" in link
    assert browser.get(link.replace("&amp;", "&")).status_code == 200


def test_jobs_that_change_or_go_are_seen_and_only_they_are_read(
    browser: Any, store_job: StoreJob, store_batch: StoreBatch, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    batch = store_batch(3)
    statuses = enumerate(("Completed", "Running", "Completed"))
    passed, runs, gone = (store_job(each, batch=batch, request_index=index) for index, each in statuses)
    page = f"/console/batches/{id_of(batch)}"
    assert browser.get(page).text.count("/console/jobs/sim-") == 3
    read: list[list[str]] = []
    get_many = service.catalog.get_many

    def counted(arns: Any, *members: Any) -> Any:
        read.append([id_of(arn) for arn in arns if ":simulation-job/" in arn])
        return get_many(arns, *members)

    monkeypatch.setattr(service.catalog, "get_many", counted)
    for event in ("terminate", "complete"):
        service.catalog.transition(service.arn("simulation-job", runs), event)
    service.catalog.delete(service.arn("simulation-job", gone))
    again = browser.get(page).text
    assert [each for each in read if each] == [[runs]]
    assert (passed in again, f"{runs}: running" in again, gone in again) == (True, False, False)


def test_a_batch_that_changes_is_read_again(browser: Any, store_batch: StoreBatch, service: Service) -> None:
    batch = store_batch(3, tags={"team": "red"})
    assert "0 of 3" in browser.get("/console/batches").text
    service.catalog.transition(batch, "drain")
    service.catalog.transition(batch, "complete", document_changes={"verdicts": {"PASS": 2, "FAIL": 1}})

    assert "</svg>failed</span>" in browser.get("/console/batches").text


def test_an_error_of_the_catalog_tells_no_path(
    browser: Any, service: Service, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: Any, **__: Any) -> Any:
        raise ServiceUnavailableException(f"the catalog sqlite:///{service.settings.home}/catalog.db does not answer")

    monkeypatch.setattr(service.catalog, "list", fail)
    answer = browser.get("/console/jobs")

    assert (answer.status_code, str(service.settings.home) in answer.text) == (503, False)
    assert "log says why" in answer.text
    assert "does not answer" in caplog.text


@pytest.mark.parametrize(
    ("url", "shown"),
    [("http://127.0.0.1:4321/", True), ("https://evil.example/", False), ("javascript:alert(1)", False), (7, False)],
)
def test_a_running_job_leads_to_its_live_view(
    browser: Any, store_job: StoreJob, service: Service, monkeypatch: pytest.MonkeyPatch, url: object, shown: bool
) -> None:
    monkeypatch.setattr("prefect_robomaker.deployments.console.jobs._EVERY_S", 0.01)
    job = store_job("Terminating", run_id="run-1")
    (service.folder("jobs", job, "run-1", "work") / "live-view.json").write_text(json.dumps({"url": url, "pid": 1}))
    read, looks = service.catalog.get, iter(range(1))

    def get(*words: str, **more: str) -> object:
        if next(looks, None) is None:
            service.catalog.transition(service.arn("simulation-job", job), "complete")
        return read(*words, **more)

    monkeypatch.setattr(service.catalog, "get", get)
    sent = events(browser.get(f"/console/jobs/{job}/live").text)
    told = [data["live-view"] for name, data in sent if name == "parts" and isinstance(data, dict)]

    assert [f'href="{url}"' in each for each in told] == [shown]


def test_the_failing_jobs_video_is_a_click_from_where_the_quickstart_ends(
    browser: Any, store_job: StoreJob, service: Service
) -> None:
    passed = store_job(verdict="PASS", files={"poster.png": b"p"})
    failed = store_job(verdict="FAIL", verdict_reason="late", files={"video.mp4": b"film", "poster.png": b"p"})
    records = [
        make_job(index, letter).model_copy(update={"label": job, "arn": service.arn("simulation-job", job)})
        for index, (letter, job) in enumerate((("P", passed), ("F", failed)))
    ]
    record = make_night(records, name="quickstart", runs=service.settings.home / "runs")
    store_night(record)
    for start in (f"/console/runs/{record.run_id}", "/console"):  # `robomaker run` ends with the first
        links = re.findall(r'href="(/console/jobs/[^"]+)"', browser.get(start).text)
        assert f'src="{links[0]}/files/video.mp4"' in browser.get(links[0]).text


@pytest.mark.parametrize(("verdicts", "command"), [("PP", "rerun {}<"), ("PF", "rerun {} --failed<")])
def test_a_run_in_which_nothing_failed_is_not_run_again_for_what_failed(
    browser: Any, service: Service, verdicts: str, command: str
) -> None:
    night = make_night(verdicts, runs=service.settings.home / "runs")
    store_night(night)
    assert command.format(night.run_id) in browser.get(f"/console/runs/{night.run_id}").text


def test_jobs_of_a_challenge_are_not_offered_to_run_again(browser: Any, service: Service) -> None:
    runs = service.settings.home / "runs"
    night, challenge = make_night("PF", name="flats", runs=runs), make_night("PF", name="flats-challenge", runs=runs)
    store_night(night)
    store_night(challenge.model_copy(update={"probe": True, "challenge": Challenge(sabotages=[])}))
    assert "robomaker rerun" in browser.get(f"/console/runs/{night.run_id}").text
    page = browser.get(f"/console/runs/{challenge.run_id}").text
    assert challenge.run_id in page
    assert "rerun" not in page
    assert "Run it again" not in page


@pytest.mark.parametrize("early", [True, False])
def test_a_run_beside_an_earlier_one_begins_with_its_answer(browser: Any, service: Service, early: bool) -> None:
    against = AgainstAnswer(
        run_id="nightly-1", alpha=0.05, answer="better", why="decided after 64 of 256 pairs", pairs=64, planned=256,
        saved=192 if early else 0, stopped_early=early,
    )  # fmt: skip
    night = make_night("PPCC", runs=service.settings.home / "runs").model_copy(update={"against": against})
    store_night(night)

    page = browser.get(f"/console/runs/{night.run_id}").text
    answer = page.index("Better than nightly-1: decided after 64 of 256 pairs")
    assert answer < page.index("2 of 4 jobs passed")
    assert ("192 trials saved" in page) is early
    assert ("robomaker rerun" not in page) is early
    assert "better · 2 of 4 jobs passed" in browser.get("/console/runs").text


def test_the_page_of_a_challenge_has_its_table(browser: Any, service: Service) -> None:
    challenge = Challenge(
        sabotages=[
            SabotageResult(name="idle", axes={"command_gain": 0}, caught=1, missed=1, first="to-bed", first_s=31.9),
            SabotageResult(name="<b>late</b>", axes={"motor_delay_s": 0.5}, missed=2),
            SabotageResult(name="blind", axes={"lidar_dropout": 1}, not_applicable=2, reason="it has no lidar"),
        ],
        jobs=[ChallengedJob(name="job 1", control="passes"), ChallengedJob(name="job 2", control="passes"),
              ChallengedJob(name="job 3", control="fails", reason="gentle")],
    )  # fmt: skip
    night = make_night("PPF", name="flats-challenge", runs=service.settings.home / "runs")
    store_night(night.model_copy(update={"probe": True, "challenge": challenge}))

    page = browser.get(f"/console/runs/{night.run_id}").text
    table = page[page.index('id="challenge"') :]

    assert "1 of 2 sabotages caught; 1 not applicable" in table
    cells = re.findall(r'<th scope="row">([^<]+)</th><td class="n">([^<]*)</td><td>([^<]+)</td>', table)
    assert cells == [
        ("idle", "1 of 2", "caught by 1 of 2 jobs, first by to-bed at 31.9 s, missed by 1"),
        ("&lt;b&gt;late&lt;/b&gt;", "0 of 2", "missed by both jobs; nothing here would notice it"),
        ("blind", "", "not applicable: it has no lidar"),
    ]
    assert "job 3: the robot fails here without a sabotage (gentle), so this job shows nothing" in table


def test_the_page_of_a_run_says_why_its_trials_failed(browser: Any, service: Service) -> None:
    [carpet] = [each for each in planted("causes") if each["id"] == "carpet"]
    night = make_night("F", runs=service.settings.home / "runs")
    store_night(night)
    page = f"/console/runs/{night.run_id}"
    assert 'id="why"' not in browser.get(page).text
    write_why(explain(draw(carpet, 1).table), night.run_dir)

    shown = browser.get(page).text

    assert "<strong>FLOOR = carpet</strong>: 38 of 186, elsewhere 8 of 367: 9.5 times as often" in shown
    assert '<svg class="cause-plot"' in shown
    assert 'robomaker repro sim-0 <span class="whole">--trial 49</span>' in shown
