"""Who gets in, what pages of others may not do, and what visitors may."""

import html
import re
from collections.abc import Callable
from contextlib import closing
from typing import Any

import httpx
import pytest
from helpers.night_records import make_job, make_night, store_night
from helpers.small_flat import BODY

from prefect_robomaker.deployments.endpoint.application import LOGGER, write_access_log
from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.deployments.spec_runs.spec_runs import Standing, write_standing
from prefect_robomaker.schemas.reports.run_record import RunRecord, StepRecord
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.inspection.reports import report_of_world
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for
from prefect_robomaker.tasks.worldforge.pictures import preview
from prefect_robomaker.tasks.worlds.keeping import keep_world

ALICE = AccessKey("AKID", "word", "alice")
READER = AccessKey("READ", "word", "reader", "read")
RED = AccessKey("RED", "word", "red", "submit", (), ("team=red",))
Visitor = Callable[..., Any]
StoreJob = Callable[..., str]
NASTY = "<script>alert('x')</script>"


def log_in(client: Any, key: AccessKey = ALICE, to: str = "/console/jobs") -> httpx.Response:
    return client.post("/console/login", data={"key": key.id, "secret": key.secret, "to": to})


def form_token(page: httpx.Response) -> str:
    found = re.search(r'name="form_token" value="([^"]+)"', page.text)
    assert found, page.text
    return html.unescape(found[1])


def test_without_access_keys_pages_are_open(browser: Any) -> None:
    for path in ("", "/batches", "/jobs", "/worlds", "/runs"):
        assert browser.get(f"/console{path}").status_code == 200
    assert browser.get("/health").json()["status"] == "ok"


def test_with_access_keys_a_visitor_logs_in_and_comes_where_he_wanted_to(visitor: Visitor) -> None:
    client = visitor(ALICE)
    asked = client.get("/console/jobs?status=Failed")
    assert (asked.status_code, asked.headers["location"]) == (
        303,
        "/console/login?to=/console/jobs%3Fstatus%3DFailed",
    )
    assert 'value="/console/jobs?status=Failed"' in client.get(asked.headers["location"]).text

    answer = log_in(client, to="/console/jobs?status=Failed")
    cookie = answer.headers["set-cookie"].lower()
    assert (answer.status_code, answer.headers["location"]) == (303, "/console/jobs?status=Failed")
    for part in ("httponly", "samesite=lax", "path=/console", "max-age=43200"):
        assert part in cookie
    assert "secure" not in cookie
    page = client.get("/console/jobs")
    assert "alice" in page.text
    assert "word" not in page.text

    out = client.post("/console/logout", data={"form_token": form_token(page)})
    assert out.status_code == 303
    assert client.get("/console/jobs").status_code == 303


def test_over_https_the_cookie_is_for_https_only(visitor: Visitor) -> None:
    client = visitor(ALICE, address="https://robots.example")

    assert "secure" in log_in(client).headers["set-cookie"].lower()


def test_a_wrong_secret_is_told(visitor: Visitor) -> None:
    client = visitor(ALICE)
    answer = log_in(client, AccessKey("AKID", "guess"))

    assert answer.status_code == 403
    assert "set-cookie" not in answer.headers
    assert "no access key with this id" in answer.text


def test_a_form_with_too_many_fields_logs_nobody_in(visitor: Visitor) -> None:
    browser = visitor(ALICE)
    assert browser.post("/console/login", data={f"field{number}": "x" for number in range(99)}).status_code == 403


@pytest.mark.parametrize("to", ["https://evil.example/", "//evil.example", "/console\\@evil.example", "/console\n", ""])
def test_a_login_leads_to_no_other_site(visitor: Visitor, to: str) -> None:
    assert log_in(visitor(ALICE), to=to).headers["location"] == "/console"


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"host": "evil.example"}, 400),
        ({"origin": "http://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"sec-fetch-site": "cross-site"}, 403),
        ({"sec-fetch-site": "same-site"}, 403),
    ],
)
def test_pages_of_others_are_refused(browser: Any, headers: dict[str, str], status: int) -> None:
    assert browser.get("/console", headers=headers).status_code == status
    assert browser.post("/console/jobs/sim-1/cancel", headers=headers).status_code == status


def test_links_from_other_sites_lead_to_pages(browser: Any) -> None:
    headers = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}

    assert browser.get("/console/jobs", headers=headers).status_code == 200


def test_the_policy_lets_nothing_but_own_files_run(browser: Any) -> None:
    for path in ("/console", "/console/nothing", "/console/jobs/sim-none"):
        answer = browser.get(path)
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert not re.search(r"<script(?! src=\"/console/)|style=|\son[a-z]+=", answer.text)


def test_assets_are_found_where_pages_say(browser: Any) -> None:
    found = re.findall(r'(?:href|src)="(/console/assets/[^"]+)"', browser.get("/console").text)
    types = {browser.get(path).headers["content-type"].partition(";")[0] for path in found}

    assert types == {"text/css", "text/javascript"}
    assert browser.get("/console/assets/1/console.py").status_code == 404


def test_names_from_outside_are_text(browser: Any, store_job: StoreJob) -> None:
    job = store_job("Failed", tags={NASTY: NASTY}, failure_code="Internal", failure_reason=NASTY)
    for path in ("", "/jobs", f"/jobs/{job}", f"/search?q={NASTY}", f"/jobs?tag={NASTY}", f"/worlds?template={NASTY}"):
        page = browser.get(f"/console{path}").text
        assert "<script>alert" not in page
    assert html.escape(NASTY, quote=False).replace("'", "&#39;") in browser.get("/console").text


def test_a_form_without_its_token_does_nothing(browser: Any, store_job: StoreJob, service: Service) -> None:
    job = store_job("Running")
    token = form_token(browser.get(f"/console/jobs/{job}"))
    refused = browser.post(f"/console/jobs/{job}/cancel", data={"form_token": "guess"})
    assert refused.status_code == 403
    assert service.catalog.standing(service.arn("simulation-job", job)) == ("Running", False)

    done = browser.post(f"/console/jobs/{job}/cancel", data={"form_token": token})
    assert (done.status_code, done.headers["location"]) == (303, f"/console/jobs/{job}")
    assert service.catalog.standing(service.arn("simulation-job", job))[1]


def test_a_key_that_only_reads_has_no_buttons_and_may_not_act(
    visitor: Visitor, store_job: StoreJob, service: Service
) -> None:
    client, job = visitor(READER), store_job("Running")
    log_in(client, READER)
    page = client.get(f"/console/jobs/{job}")
    assert "/cancel" not in page.text

    answer = client.post(f"/console/jobs/{job}/cancel", data={"form_token": form_token(page)})
    assert answer.status_code == 403
    assert "robomaker_scope = submit" in answer.text
    assert not service.catalog.standing(service.arn("simulation-job", job))[1]


def test_acts_are_in_the_audit_log(visitor: Visitor, store_job: StoreJob, tmp_path: Any, service: Service) -> None:
    from prefect_robomaker.deployments.endpoint.calling.audit_log import AuditLog

    job = store_job("Running")
    with AuditLog(tmp_path / "audit", service.clock) as audit_log:
        client = visitor(ALICE, audit_log=audit_log)
        log_in(client)
        token = form_token(client.get(f"/console/jobs/{job}"))
        client.post(f"/console/jobs/{job}/cancel", data={"form_token": token})
        client.post("/console/jobs/sim-none/cancel", data={"form_token": token})
    done, refused = (tmp_path / "audit").read_text().splitlines()

    assert '"caller": "alice"' in done
    assert '"operation": "CancelSimulationJob"' in done
    assert '"outcome": "ok"' in done
    assert '"outcome": "ResourceNotFoundException"' in refused


def test_a_confined_key_sees_only_what_is_its_own(
    visitor: Visitor, store_job: StoreJob, store_batch: Callable[..., str]
) -> None:
    client = visitor(ALICE, RED)
    batch = store_batch(2, tags={"team": "red"})
    own = store_job("Failed", tags={"team": "red"}, files={"logs/stdout.log": b"own"})
    other = store_job("Failed", batch=batch, tags={"team": "blue"}, files={"logs/stdout.log": b"other"})
    log_in(client, RED)

    for path in ("", "/jobs", f"/batches/{batch.rpartition('/')[2]}"):
        page = client.get(f"/console{path}").text
        assert other not in page
    assert own in client.get("/console/jobs").text
    assert client.get(f"/console/jobs/{own}").status_code == 200
    for path in ("", "/live", "/files/logs/stdout.log"):
        assert client.get(f"/console/jobs/{other}{path}").status_code == 404
    assert client.get(f"/console/search?q={other}").status_code == 404


def test_a_confined_key_sees_runs_of_which_it_may_see_everything(
    visitor: Visitor, store_job: StoreJob, store_batch: Callable[..., str], service: Service
) -> None:
    def store(name: str, *teams: str, batch_of: str = "red") -> RunRecord:
        batch = store_batch(len(teams), tags={"team": batch_of})
        jobs = [store_job("Failed", batch=batch, tags={"team": team}) for team in teams]
        records = [
            make_job(index, "F").model_copy(update={"label": job, "arn": service.arn("simulation-job", job)})
            for index, job in enumerate(jobs)
        ]
        step = StepRecord(name="drive", operation="StartSimulationJobBatch", status="Completed", arn=batch)
        record = make_night(records, name=name, runs=service.settings.home / "runs")
        store_night(record.model_copy(update={"steps": [step]}))
        (record.run_dir / "report.html").write_text(f"report of {name}")
        return record

    own, mixed, others = store("own", "red", "red"), store("mixed", "red", "blue"), store("others", "red", batch_of="")
    ordered = store("ordered", "blue", batch_of="blue")
    write_standing(ordered.run_dir, Standing(name="ordered", key_id=RED.id))
    client = visitor(ALICE, RED)
    log_in(client, RED)

    for path in ("", "/runs"):
        page = client.get(f"/console{path}").text
        seen = [run.run_id for run in (own, mixed, others, ordered) if run.run_id in page]
        assert seen == [own.run_id, ordered.run_id], path
    for run, status in ((own, 200), (mixed, 404), (others, 404), (ordered, 200)):
        for path in ("", "/report"):
            assert client.get(f"/console/runs/{run.run_id}{path}").status_code == status, (run.name, path)
    assert client.get(f"/console/runs/{own.run_id}/report").text == "report of own"
    listed = client.get("/console/history").text
    assert [name for name in ("own", "mixed", "others", "ordered") if f"/history/{name}" in listed] == [
        "own",
        "ordered",
    ]
    assert client.get("/console/history/own").text.count('class="night"') == 1
    assert client.get("/console/history/mixed").status_code == 404
    service.catalog.set_tags(own.jobs[1].arn or "", {"team": "blue"})
    assert client.get(f"/console/runs/{own.run_id}/report").status_code == 404
    assert client.get("/console/history/own").status_code == 404


def test_a_confined_key_does_not_see_the_body_of_a_template_of_others(
    visitor: Visitor, template: str, service: Service
) -> None:
    client = visitor(ALICE, RED)
    log_in(client, RED)
    page = f"/console/worlds?template={template.rpartition('/')[2]}"
    assert "Buildings" not in client.get(page).text
    service.catalog.set_tags(template, {"team": "red"})
    assert "Buildings" in client.get(page).text


def test_what_is_not_there_is_told(browser: Any) -> None:
    for path in ("/jobs/sim-none", "/batches/none", "/worlds/a/world-1", "/runs/none", "/runs/%2e%2e", "/nothing"):
        answer = browser.get(f"/console{path}")
        assert answer.status_code == 404, path
        assert "text/html" in answer.headers["content-type"]
    assert browser.get("/console/jobs?after=guess").status_code == 400


def test_two_servers_on_one_host_keep_their_sessions_apart(visitor: Visitor) -> None:
    names = {
        log_in(visitor(ALICE, address=f"http://127.0.0.1:{port}")).headers["set-cookie"].partition("=")[0]
        for port in (8057, 8058)
    }

    assert len(names) == 2


def test_who_says_https_himself_is_not_believed(visitor: Visitor) -> None:
    client = visitor(ALICE)
    form = {"key": ALICE.id, "secret": ALICE.secret, "to": "/console"}
    answer = client.post("/console/login", data=form, headers={"x-forwarded-proto": "https"})

    assert "secure" not in answer.headers["set-cookie"].lower()


def test_no_link_leads_a_confined_key_to_what_it_may_not_see(
    visitor: Visitor, store_job: StoreJob, store_batch: Callable[..., str]
) -> None:
    client = visitor(ALICE, RED)
    batch = store_batch(1, spec_run="night-1")
    own = store_job("Failed", batch=batch, tags={"team": "red"}, spec_run="night-1", files={"a.txt": b"a"})
    log_in(client, RED)
    page = client.get(f"/console/jobs/{own}").text
    links = {link for link in re.findall(r'href="(/console/[^"#]*)"', page) if "/assets/" not in link}

    assert len(links) > 3
    assert [link for link in links if client.get(link).status_code >= 400] == []


def test_requests_are_counted_and_logged(visitor: Visitor, tmp_path: Any) -> None:
    client = visitor()
    with closing(write_access_log(tmp_path / "log")) as handler:
        client.get("/console/jobs")
        client.get("/console/jobs/sim-none/live")
        client.get("/console", headers={"host": "evil.example"})
        LOGGER.removeHandler(handler)
    metrics = client.get("/metrics").text

    assert [line.split()[2:5] for line in (tmp_path / "log").read_text().splitlines()] == [
        ["GET", "/console/jobs", "200"],
        ["GET", "/console/jobs/sim-none/live", "404"],
        ["GET", "/console", "400"],
    ]
    assert 'robomaker_http_requests_total{operation="console",status="200"} 1.0' in metrics
    assert 'robomaker_http_requests_total{operation="console-stream",status="404"} 1.0' in metrics


def test_an_imported_world_has_its_name_and_its_picture_is_drawn_when_it_is_looked_at(
    service: Service, browser: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = generate_world(WorldTemplateBody.model_validate(BODY), *seeds_for(7, 0, 0), settle=False)
    kept = keep_world(world, "import", {}, service, name="my <flat>")
    monkeypatch.setattr(preview, "render_preview", lambda _: b"picture")
    picture = browser.get(f"/console/worlds/{kept.id}/preview.png")
    assert (picture.status_code, picture.headers["content-type"], picture.content) == (200, "image/png", b"picture")
    for page in ("/console/worlds", f"/console/worlds/{kept.id}"):
        assert "my &lt;flat&gt;" in browser.get(page).text, page
    assert report_of_world(kept.arn, service).worlds[0].name == "my <flat>"
    assert browser.get("/console/search?q=my+%3Cflat%3E").headers["location"] == f"/console/worlds/{kept.id}"
