"""Starting a run from the console: what is checked, who may, and what is ordered."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.deployments.endpoint.calling.audit_log import AuditLog
from prefect_robomaker.deployments.spec_runs.visitor_specifications import shipped_specs
from prefect_robomaker.tasks.service.service import Service

Enter = Callable[..., Any]
QUICKSTART = shipped_specs()["quickstart"]
RED = AccessKey("RED", "word", "red", "submit", (), ("team=red",))
SUBMIT = AccessKey("SUBMIT", "word", "submitter", "submit")
READER = AccessKey("READ", "word", "reader", "read")
ADMIN = AccessKey("ADMIN", "word", "admin")


def batch_spec(tags: dict[str, str], application: str = "scout") -> str:
    """A specification of one batch."""
    request = {
        "maxJobDurationInSeconds": 60,
        "iamRole": "arn:aws:iam::000000000000:role/test",
        "tags": tags,
        "robotApplications": [{"application": application, "launchConfig": {"command": ["./drive"]}}],
    }
    step = {"operation": "StartSimulationJobBatch", "input": {"createSimulationJobRequests": [request], "tags": tags}}
    return json.dumps({"version": 1, "name": "one", "steps": {"drive": step}})


def test_a_specification_of_the_package_is_shown_checked_and_ordered(enter: Enter, runs: Any) -> None:
    visitor = enter()
    page = visitor.get("/runs/new?spec=quickstart").text
    assert "after template" in page
    answer = visitor.send("/runs/new", text=QUICKSTART.replace("\n", "\r\n"), do="start")
    [order] = runs.orders
    assert (answer.status_code, answer.headers["location"]) == (303, f"/console/runs/{order.run_id}")
    assert (order.text, order.spec_path) == (QUICKSTART, "quickstart")
    assert order.command == ["robomaker", "run", "quickstart"]
    shown = visitor.get(f"/runs/{order.run_id}").text
    assert all(word in shown for word in ("StartSimulationJobBatch", "Goes on also when", "/cancel"))
    assert order.run_id in visitor.get("/runs").text


def test_problems_are_told_by_line_and_nothing_is_ordered(enter: Enter, runs: Any) -> None:
    text = QUICKSTART.replace("CreateWorldTemplate", "CreateWorldTemplat").replace("name: quickstart", "name: q <b>")
    for path in ("/runs/new", "/runs/new/check"):
        answer = enter().send(path, text=text, do="start")
        assert answer.status_code == (400 if path == "/runs/new" else 200)
        assert "did you mean &#39;CreateWorldTemplate&#39;?" in answer.text
        assert 'data-line="18"' in answer.text
        assert 'data-line="10"' in answer.text
        assert "<b>" not in answer.text
    assert runs.orders == []


def test_entries_that_do_not_fit_are_told_to_a_confined_key_like_other_problems(enter: Enter, runs: Any) -> None:
    requests = {"forEach": [{"name": "red"}, {}], "value": {"tags": {"team": "${{ item.name }}"}}}
    text = json.loads(batch_spec({"team": "red"}))
    value = text["steps"]["drive"]["input"]["createSimulationJobRequests"][0] | requests["value"]
    text["steps"]["drive"]["input"]["createSimulationJobRequests"] = requests | {"value": value}
    answer = enter(RED).send("/runs/new", text=json.dumps(text), do="start")
    assert (answer.status_code, "item.name gives nothing" in answer.text, runs.orders) == (400, True, [])


def test_applications_that_do_not_exist_are_told_beside_the_text(enter: Enter, runs: Any) -> None:
    answer = enter().send("/runs/new", text=batch_spec({}, "scuot"), do="start")
    assert answer.status_code == 400
    assert "did you mean &#39;scout&#39;?" in answer.text
    assert runs.orders == []


def test_a_confined_key_is_not_told_names_of_worlds(enter: Enter, runs: Any) -> None:
    text = "operation: DescribeWorld\nworld: flat 1\n"
    for key, code in ((None, 400), (RED, 403)):
        answer = (enter() if key is None else enter(key)).send("/runs/new", text=text, do="start")
        assert answer.status_code == code
        assert ("is neither ARN, id nor name" in answer.text) == (key is None)
        assert ("may name worlds by ARNs only" in answer.text) == (key is not None)
    assert runs.orders == []


def test_checking_orders_nothing(enter: Enter, runs: Any) -> None:
    answer = enter().send("/runs/new", text=QUICKSTART, do="check")
    assert (answer.status_code, "valid" in answer.text) == (200, True)
    assert runs.orders == []


def test_a_file_is_taken_in_place_of_the_text(enter: Enter, runs: Any) -> None:
    visitor = enter()
    file = {"file": ("../my night.yaml", batch_spec({}).encode(), "application/yaml")}
    data = {"form_token": visitor.token, "text": "nonsense", "do": "start"}
    answer = visitor.browser.post("/console/runs/new", data=data, files=file)
    [order] = runs.orders
    assert answer.status_code == 303
    assert order.filename == "my night.yaml"
    assert order.spec_path.endswith(f"/runs/{order.run_id}/spec.yaml")


@pytest.mark.parametrize(
    ("key", "text", "why"),
    [
        (READER, batch_spec({}), "robomaker_scope = submit"),
        (SUBMIT, QUICKSTART, "CreateWorldTemplate needs an access key with robomaker_scope = administer"),
        (RED, batch_spec({"team": "blue"}), "a tag that begins with team=red"),
        (RED, batch_spec({"team": "red"}, "secret"), "is not among the resources of this access key"),
    ],
    ids=["reads only", "a step beyond the scope", "tags of others", "applications of others"],
)
def test_what_the_key_is_not_good_for_is_refused(enter: Enter, runs: Any, key: AccessKey, text: str, why: str) -> None:
    answer = enter(key).send("/runs/new", text=text, do="start")
    assert answer.status_code == 403
    assert why in answer.text
    assert runs.orders == []


def test_a_key_that_only_reads_has_no_form(enter: Enter) -> None:
    reader = enter(READER)
    assert "/runs/new" not in reader.get("/runs").text
    assert reader.get("/runs/new").status_code == 403
    assert reader.send("/runs/new/check", text=QUICKSTART).status_code == 403


def test_a_confined_key_orders_what_is_its_own_and_sees_that_run_only(enter: Enter, runs: Any) -> None:
    red, admin = enter(RED), enter(ADMIN)
    assert red.send("/runs/new", text=batch_spec({"team": "red"}), do="start").status_code == 303
    assert admin.send("/runs/new", text=batch_spec({}), do="start").status_code == 303
    own, other = (order.run_id for order in runs.orders)
    assert [order.key_id for order in runs.orders] == ["RED", "ADMIN"]
    assert [red.get(f"/runs/{each}").status_code for each in (own, other)] == [200, 404]
    assert [admin.get(f"/runs/{each}").status_code for each in (own, other)] == [200, 200]
    assert red.send(f"/runs/{other}/cancel").status_code == 404
    assert red.send(f"/runs/{own}/cancel").status_code == 303
    assert runs.cancelled == [own]
    assert enter(READER).send(f"/runs/{own}/cancel").status_code == 403


@pytest.mark.parametrize("path", ["/runs/new", "/runs/new/check"])
def test_forms_of_others_order_nothing(enter: Enter, runs: Any, path: str) -> None:
    visitor = enter()
    for headers in ({"origin": "http://evil.example"}, {"sec-fetch-site": "cross-site"}):
        assert visitor.send(path, headers=headers, text=QUICKSTART, do="start").status_code == 403
    assert visitor.send(path, headers={"host": "evil.example"}, text=QUICKSTART, do="start").status_code == 400
    visitor.token = "guess"
    assert visitor.send(path, text=QUICKSTART, do="start").status_code == 403
    assert runs.orders == []


def test_a_visitor_without_a_session_orders_nothing(enter: Enter, runs: Any) -> None:
    visitor = enter(ADMIN)
    visitor.browser.post("/console/logout", data={"form_token": visitor.token})
    assert visitor.send("/runs/new", text=QUICKSTART, do="start").status_code == 403
    assert runs.orders == []


def test_too_long_a_text_is_refused(enter: Enter, runs: Any) -> None:
    answer = enter().send("/runs/new", text="#" * 600_000, do="start")
    assert (answer.status_code, "the form may have at most 512 KB" in answer.text) == (413, True), answer.text
    assert runs.orders == []


def test_who_starts_and_cancels_runs_is_in_the_audit_log(
    enter: Enter, runs: Any, service: Service, tmp_path: Path
) -> None:
    with AuditLog(tmp_path / "audit", service.clock) as audit_log:
        red, reader = (enter(key, audit_log=audit_log) for key in (RED, READER))
        for text in (batch_spec({"team": "red"}), batch_spec({"team": "blue"}), "nonsense"):
            red.send("/runs/new", text=text, do="check")
            red.send("/runs/new", text=text, do="start")
        reader.send("/runs/new", text=QUICKSTART, do="start")
        [order] = runs.orders
        red.send(f"/runs/{order.run_id}/cancel")
        reader.send(f"/runs/{order.run_id}/cancel")
        red.send("/runs/night-20260101T000000000/again")
    lines = [json.loads(line) for line in (tmp_path / "audit").read_text().splitlines()]
    assert [(line["caller"], line["operation"], line["resources"], line["outcome"]) for line in lines] == [
        ("red", "StartRun", [order.run_id], "ok"),
        ("red", "StartRun", [], "AccessDeniedException"),
        ("red", "StartRun", [], "InvalidParameterException"),
        ("reader", "StartRun", [], "AccessDeniedException"),
        ("red", "CancelRun", [order.run_id], "ok"),
        ("reader", "CancelRun", [order.run_id], "AccessDeniedException"),
        ("red", "StartRun", [], "ResourceNotFoundException"),
    ]


def test_a_server_that_performs_nothing_says_so(visitor: Callable[..., Any], service: Service) -> None:
    page = visitor().get("/console/runs/new")
    assert (page.status_code, "--execute none" in page.text) == (400, True)
    assert "/runs/new" not in visitor().get("/console/runs").text


def test_a_run_that_broke_off_says_why(enter: Enter, runs: Any) -> None:
    visitor = enter()
    visitor.send("/runs/new", text=batch_spec({}), do="start")
    [order] = runs.orders
    runs.ended.add(order.run_id)
    (runs.home / "runs" / order.run_id / "process.log").write_text("Killed <b>")
    page = visitor.get(f"/runs/{order.run_id}").text
    assert all(word in page for word in ("never begun", "Killed &lt;b&gt;"))
    assert "/cancel" not in page
    assert "event: end" in visitor.get(f"/runs/{order.run_id}/live").text


def test_a_run_whose_process_was_killed_goes_on_when_a_visitor_says_so(enter: Enter, runs: Any) -> None:
    red, reader = enter(RED), enter(READER)
    red.send("/runs/new", text=batch_spec({"team": "red"}), do="start")
    [order] = runs.orders
    runs.ended.add(order.run_id)
    assert "/take-up" not in red.get(f"/runs/{order.run_id}").text  # it ended by itself
    assert red.send(f"/runs/{order.run_id}/take-up").status_code == 400
    runs.killed.add(order.run_id)
    page = red.get(f"/runs/{order.run_id}").text
    assert "It goes on when <code>robomaker serve</code> starts again, or with the button above." in page
    assert reader.send(f"/runs/{order.run_id}/take-up").status_code == 403
    assert enter(ADMIN).send("/runs/one-20260101T000000000/take-up").status_code == 404
    assert red.send(f"/runs/{order.run_id}/take-up").status_code == 303
    assert runs.going() == [order.run_id]
    assert "/cancel" in red.get(f"/runs/{order.run_id}").text


WITH_PARAMETERS = """\
version: 1
name: flats
parameters:
  worlds: {type: integer, minimum: 1, default: 4, description: How <many>}
  fast: {type: boolean, default: true}
  arm: {enum: [a, b]}
steps:
  flat:
    operation: CreateWorldTemplate
    input: {name: "flat ${{ parameters.worlds }}", templateBody: {Version: "1"}, tags: {arm: "${{ parameters.arm }}"}}
"""


def test_a_form_asks_for_parameters_with_their_defaults_and_choices(enter: Enter) -> None:
    page = enter().send("/runs/new/check", **{"text": WITH_PARAMETERS, "parameter.worlds": "20"}).text
    assert 'name="parameter.worlds" value="20" placeholder="4"' in page
    assert "How &lt;many&gt;" in page
    assert '<option value="">true</option><option>true</option><option>false</option>' in page
    assert '<option value="">choose</option><option>a</option><option>b</option>' in page
    assert "Before it can start, arm needs a value." in page
    assert "valid" in page


def test_a_run_is_ordered_with_the_values_of_the_form(enter: Enter, runs: Any) -> None:
    fields = {"text": WITH_PARAMETERS, "parameter.worlds": "20", "parameter.arm": "b", "parameter.fast": ""}
    answer = enter().send("/runs/new", **fields, do="start")
    assert answer.status_code == 303
    [order] = runs.orders
    assert order.parameters == {"worlds": 20, "fast": True, "arm": "b"}
    assert order.command[-6:] == ["--set", "worlds=20", "--set", "fast=true", "--set", "arm=b"]


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({}, "has neither a value nor a default"),
        ({"parameter.arm": "c"}, "the value given is &#39;c&#39;; it has to be a or b"),
        (
            {"parameter.arm": "a", "parameter.worlds": "0"},
            "the value given is &#39;0&#39;; it has to be a whole number, at least 1",
        ),
    ],
)
def test_nothing_is_ordered_with_wrong_values(enter: Enter, runs: Any, fields: dict[str, str], problem: str) -> None:
    answer = enter().send("/runs/new", **{"text": WITH_PARAMETERS, **fields}, do="start")
    assert answer.status_code == 400
    said = problem.replace("&#39;0&#39;", "0")
    assert said in answer.text
    assert runs.orders == []
    [name] = re.findall(r'aria-invalid="true" aria-describedby="refused-(\w+)"', answer.text)
    assert said in re.findall(rf'id="refused-{name}">([^<]*)<', answer.text)[0], "beside its field"
    assert f'href="#parameter-{name}"' in answer.text
    assert "Allowed: a whole number, at least 1" in answer.text


def test_values_outlast_a_text_that_cannot_be_read_for_a_moment(enter: Enter) -> None:
    page = enter().send("/runs/new/check", **{"text": WITH_PARAMETERS + "\n[", "parameter.worlds": "20"}).text
    assert '<input type="hidden" name="parameter.worlds" value="20">' in page
