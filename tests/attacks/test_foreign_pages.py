"""What a web page of others, open in the user's browser, does to servers on this machine: tried in real Chromium.

A request that was refused looks to its page like one that was not, so every test looks at the server's content. All
attacks are tried on a bare Prefect server first, where they succeed: they would show that a guard is missing.
"""

import base64
import http.server
import json
import threading
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import httpx
import pytest
from helpers.bare_prefect_server import bare_prefect_server
from helpers.browser import NEEDS_BROWSER, Browser, browsing
from helpers.endpoint_here import ServeHere
from helpers.prefect_server import server_settings
from helpers.processes import wait_for

from prefect_robomaker.deployments.prefect_server.secret import auth_string

pytestmark = NEEDS_BROWSER

REBOUND = "rebound.example"

PAGE = """<!doctype html><meta charset="utf-8"><iframe name="sink"></iframe><script>
const MARK = new URLSearchParams(location.search).get("mark");
const settled = (promise) => Promise.race([promise, new Promise((r) => setTimeout(() => r("time-out"), 60000))])
  .catch((error) => `error: ${error}`);
const body = (name, value) => new Blob([JSON.stringify({...value, name: `${MARK}-${name}`})]);  // without a type
const JSON_TYPE = {"Content-Type": "application/json"};

// Bodies without a type need no leave of the server's.
const unasked = (url, content) =>
  settled(fetch(url, {method: "POST", mode: "no-cors", body: content}).then(() => "sent"));
const asked = (url, content) =>
  settled(fetch(url, {method: "POST", headers: JSON_TYPE, body: content}).then((answer) => answer.status));
const read = (url) => settled(fetch(url).then((answer) => answer.text()));

function picture(url) {
  return settled(new Promise((resolve) => {
    const it = new Image();
    it.onload = it.onerror = (event) => resolve(event.type);
    it.src = url;
  }));
}

function socket(url, protocol, messages) {
  return new Promise((resolve) => {
    const it = protocol ? new WebSocket(url, protocol) : new WebSocket(url);
    it.onopen = () => {
      messages.forEach((each) => it.send(JSON.stringify(each)));
      if (!protocol) setTimeout(() => resolve("open"), 1500);
    };
    it.onmessage = (message) => resolve(message.data);
    it.onclose = () => resolve("closed");
  });
}

function form(url, fields) {
  const it = document.createElement("form");
  Object.assign(it, {method: "POST", action: url, target: "sink"});
  for (const [name, value] of Object.entries(fields)) {
    const input = document.createElement("input");
    Object.assign(input, {type: "hidden", name, value});
    it.append(input);
  }
  document.body.append(it);
  it.submit();
  return new Promise((resolve) => setTimeout(() => resolve("sent"), 1500));
}
</script>"""

PREFECT_ATTACKS = """(async () => {
  const api = %(target)s + "/api", sockets = api.replace("http", "ws");
  const event = {occurred: new Date().toISOString(), event: `${MARK}-forged`, id: crypto.randomUUID(), payload: {},
                 resource: {"prefect.resource.id": "forged"}, related: []};
  const always = {since: "2020-01-01T00:00:00Z", until: "2100-01-01T00:00:00Z"};
  return {
    read: await read(api + "/admin/version"),
    blob: await unasked(api + "/flows/", body("blob", {})),
    beacon: navigator.sendBeacon(api + "/flows/", body("beacon", {})),
    json: await asked(api + "/flows/", body("json", {})),
    deployment: await unasked(api + "/deployments/", body("deployment", {flow_id: %(flow)s})),
    form: await form(api + "/deployments/" + %(deployment)s + "/pause_deployment", {}),
    in: await settled(socket(sockets + "/events/in", "", [event])),
    out: await settled(socket(sockets + "/events/out", "prefect", [{type: "auth", token: ""},
                       {type: "filter", filter: {occurred: always}}])),
  };
})()"""

SERVICE_ATTACKS = """(async () => {
  const order = %(target)s + "/createWorldTemplate";
  const template = (name) => body(name, {templateBody: '{"Version": "1"}'});
  return {
    read: await read(%(target)s + "/health"),
    blob: await unasked(order, template("blob")),
    beacon: navigator.sendBeacon(order, template("beacon")),
    json: await asked(order, template("json")),
    form: await form(order, {name: MARK + "-form"}),
    picture: await picture(%(target)s + "/health"),
    console: await read(%(target)s + "/console/jobs"),
    stream: await settled(new Promise((resolve) => {
      const it = new EventSource(%(target)s + "/console/live");
      it.onopen = () => resolve("open");
      it.onerror = () => { it.close(); resolve("closed"); };
    })),
    ordered: await form(%(target)s + "/console/jobs/" + MARK + "/cancel", {}),
    socket: await settled(socket(%(target)s.replace("http", "ws") + "/console", "", [])),
  };
})()"""


@dataclass(frozen=True)
class Prefect:
    """A Prefect server, asked as a program that may."""

    url: str
    client: httpx.Client
    flow: str
    deployment: str

    def harmed(self, mark: str) -> set[str]:
        """What is there of a page's attacks."""
        flows = self.client.post("/flows/filter", json={"flows": {"name": {"like_": mark}}}).json()
        deployments = self.client.post("/deployments/filter", json={"deployments": {"name": {"like_": mark}}}).json()
        events = self.client.post("/events/filter", json={"filter": {"event": {"name": [f"{mark}-forged"]}}}).json()
        paused = self.client.get(f"/deployments/{self.deployment}").json()["paused"]
        named = {each["name"].removeprefix(f"{mark}-") for each in (*flows, *deployments)}
        return named | ({"event"} if events["events"] else set()) | ({"paused"} if paused else set())


def prefect_at(url: str, auth: str = "") -> Prefect:
    client_id = str(uuid.uuid4())
    headers = {"Prefect-Csrf-Client": client_id}
    if auth:
        headers["Authorization"] = f"Basic {base64.b64encode(auth.encode()).decode()}"
    client = httpx.Client(base_url=f"{url}/api", headers=headers, timeout=200, trust_env=False)
    token = client.get("/csrf-token", params={"client": client_id})
    if token.status_code == 200:
        client.headers["Prefect-Csrf-Token"] = token.json()["token"]
    flow = made(client, "/flows/", {"name": f"victim-{uuid.uuid4().hex}"})
    deployment = made(client, "/deployments/", {"flow_id": flow, "name": "victim"})
    return Prefect(url, client, flow, deployment)


def made(client: httpx.Client, path: str, body: dict[str, Any]) -> str:
    """Makes something, and returns its id; a server that has just started is busy with its SQLite, and answers 5xx."""

    def post() -> httpx.Response | None:
        answer = client.post(path, json=body)
        return None if answer.is_server_error else answer

    answer = wait_for(post, f"an answer to POST {path}")
    assert answer is not None
    assert answer.is_success, answer.text
    return answer.json()["id"]


@pytest.fixture(scope="module")
def attacker() -> Iterator[int]:
    """Port of a server with a page of others."""

    class Answer(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            body = PAGE.encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as the library calls it
            """Says nothing."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Answer) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.server_address[1]
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    rules = f"--host-resolver-rules=MAP {REBOUND} 127.0.0.1"
    with browsing(tmp_path_factory.mktemp("browser") / "profile", rules) as browser:
        yield browser


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, str]]:
    with bare_prefect_server(tmp_path_factory.mktemp("bare")) as urls:
        yield urls


@pytest.fixture
def attack(browser: Browser, attacker: int) -> Callable[[str, str, dict[str, str]], tuple[str, dict[str, Any]]]:
    """Has a page of a site do its worst; returns its mark, and what the page saw."""

    def attack(site: str, script: str, values: dict[str, str]) -> tuple[str, dict[str, Any]]:
        mark = f"attack-{uuid.uuid4().hex[:8]}"
        with browser.page(f"http://{site}:{attacker}/?mark={mark}") as page:
            page.wait(lambda page: page.evaluate("typeof form === 'function' && !!document.body"), "the page of others")
            seen = page.evaluate(script % {name: json.dumps(value) for name, value in values.items()})
        return mark, seen

    return attack


SITES = pytest.mark.parametrize(
    "site",
    [
        pytest.param("127.0.0.1", id="same-site", marks=pytest.mark.endurance),
        pytest.param("localhost", id="cross-site", marks=pytest.mark.deep),
    ],
)
"""The answers of guards to a page's site are tried for each of them without a browser."""
ALL = {"blob", "beacon", "json", "deployment", "event", "paused"}


@SITES
def test_the_attacks_succeed_where_nothing_guards(attack: Any, bare: tuple[str, str], site: str) -> None:
    server = prefect_at(bare[0])

    mark, seen = attack(
        site, PREFECT_ATTACKS, {"target": server.url, "flow": server.flow, "deployment": server.deployment}
    )

    wait_for(lambda: server.harmed(mark) >= ALL, f"all attacks to succeed; the page saw {seen}")
    assert seen["read"].startswith('"3.')
    assert "auth_success" in seen["out"]


@SITES
@pytest.mark.parametrize("logged_in", [False, True], ids=["guard alone", "with login and CSRF protection"])
def test_the_attacks_fail(attack: Any, bare: tuple[str, str], prefect_server: str, site: str, logged_in: bool) -> None:
    ours = prefect_server.removesuffix("/api")
    server = prefect_at(ours, auth_string(server_settings())) if logged_in else prefect_at(bare[1])

    mark, seen = attack(
        site, PREFECT_ATTACKS, {"target": server.url, "flow": server.flow, "deployment": server.deployment}
    )

    # What is written after the attacks is there, so they would be.
    server.client.post("/flows/", json={"name": f"{mark}-afterwards"}).raise_for_status()
    wait_for(lambda: "afterwards" in server.harmed(mark), "the server's content")
    assert server.harmed(mark) == {"afterwards"}
    assert seen["read"].startswith("error")
    assert (seen["in"], seen["out"]) == ("closed", "closed")


@pytest.mark.deep
@pytest.mark.parametrize("guarded", [False, True])
def test_a_name_that_is_pointed_here_later(browser: Browser, bare: tuple[str, str], guarded: bool) -> None:
    """The page's own origin is the server then ("DNS rebinding"): the browser lets it do anything."""
    server = prefect_at(bare[guarded])
    mark = f"attack-{uuid.uuid4().hex[:8]}"
    origin = f"http://{REBOUND}:{httpx.URL(server.url).port}"

    with browser.page(f"{origin}/api/health") as page:
        page.wait(lambda page: page.evaluate("location.host").startswith(REBOUND), "the name")
        page.wait(lambda page: page.evaluate("document.readyState") == "complete", "the page")
        status = page.evaluate(
            "fetch('/api/flows/', {method: 'POST', headers: {'Content-Type': 'application/json'},"
            f" body: JSON.stringify({{name: '{mark}-rebound'}})}}).then((answer) => answer.status)"
        )
        socket = page.evaluate(
            "new Promise((resolve) => { const it = new WebSocket(location.origin.replace('http', 'ws') +"
            " '/api/events/in'); it.onopen = () => resolve('open'); it.onclose = () => resolve('closed'); })"
        )

    assert (status, socket, server.harmed(mark)) == ((400, "closed", set()) if guarded else (201, "open", {"rebound"}))


@SITES
def test_pages_of_others_order_nothing_from_the_endpoint(attack: Any, serve_here: ServeHere, site: str) -> None:
    with serve_here("--log-requests") as served:
        mark, seen = attack(site, SERVICE_ATTACKS, {"target": served.url})
        served.call("CreateWorldTemplate", {"name": f"{mark}-afterwards", "templateBody": '{"Version": "1"}'})
        templates = served.call("ListWorldTemplates", {})["templateSummaries"]

        assert [template["name"] for template in templates] == [f"{mark}-afterwards"]
        assert seen["read"].startswith("error")
        assert seen["console"].startswith("error")
        assert (seen["stream"], seen["socket"]) == ("closed", "closed")
        # Each of them arrived, and was refused: as a page's, not for its form.
        assert served.log.read_text().count(" 403 ") >= 7
