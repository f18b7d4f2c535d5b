"""The page that logs a browser in: also for one that comes without a link, and for nobody else."""

import asyncio
import base64
import json

import httpx
import pytest
from starlette.responses import PlainTextResponse
from starlette.types import Receive, Scope, Send

from prefect_robomaker.deployments.prefect_server.login_page import LINKS, LOGO, PAGE, LoginPage

ORIGIN = "http://127.0.0.1:4321"
NAVIGATION = {"sec-fetch-mode": "navigate"}
LOGGED_IN = {**NAVIGATION, "cookie": "robomaker-login-4321=1"}


async def prefect(scope: Scope, receive: Receive, send: Send) -> None:
    await PlainTextResponse("Prefect's")(scope, receive, send)


def ask(method: str, path: str, headers: dict[str, str] | None = None, **options: object) -> httpx.Response:
    async def send() -> httpx.Response:
        transport = httpx.ASGITransport(LoginPage(prefect, ORIGIN, "user:secret"))
        async with httpx.AsyncClient(transport=transport, base_url=ORIGIN) as client:
            return await client.request(method, path, headers=headers or {}, **options)  # type: ignore[arg-type]

    return asyncio.run(send())


@pytest.mark.parametrize(
    ("asked", "then"), [("/v2/runs", "/v2/runs"), ("/", "/"), ("/v2/login", "/"), ("/api/flows/filter", "/")]
)
def test_a_browser_that_comes_without_a_link_gets_the_page_that_says_how_to_log_in(asked: str, then: str) -> None:
    answer = ask("GET", asked, NAVIGATION)

    assert answer.status_code == 307
    assert httpx.URL(answer.headers["location"]).path == PAGE
    assert httpx.URL(answer.headers["location"]).params["to"] == then
    page = ask("GET", PAGE, NAVIGATION)
    assert "robomaker server status" in page.text
    assert "secret" not in page.text.replace("no secret", "")


def test_a_browser_that_is_logged_in_gets_pages_but_never_one_that_asks_for_a_password() -> None:
    assert ask("GET", "/v2/runs", LOGGED_IN).text == "Prefect's"
    assert ask("GET", "/v2/login", LOGGED_IN).status_code == 307
    assert ask("GET", "/v2/runs", {**NAVIGATION, "cookie": "robomaker-login-1=1"}).status_code == 307


def test_programs_are_led_nowhere() -> None:
    assert ask("GET", "/api/flows").text == "Prefect's"
    assert ask("POST", LINKS).status_code == 401
    assert ask("POST", PAGE, content=json.dumps({"token": "wrong"})).status_code == 403


def test_a_link_logs_one_browser_in_whoever_else_tries_it_and_when() -> None:
    """Twenty at once, each again afterwards: a link that another program saw lets in one of them, not two."""
    page = LoginPage(prefect, ORIGIN, "user:secret")
    password = base64.b64encode(b"user:secret").decode()

    async def follow() -> list[httpx.Response]:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(page), base_url=ORIGIN) as client:
            made = await client.post(LINKS, headers={"authorization": f"Basic {password}"})
            body = json.dumps({"token": made.json()["link"].partition("#")[2]})
            at_once = await asyncio.gather(*(client.post(PAGE, content=body) for _ in range(20)))
            return [*at_once, *[await client.post(PAGE, content=body) for _ in range(20)]]

    answers = asyncio.run(follow())

    assert sorted(answer.status_code for answer in answers) == [200, *[403] * 39]
    assert [answer.json().get("password") for answer in answers].count(password) == 1


@pytest.mark.parametrize("body", ["[" * 1023, "", "{}", '{"token": 1}', '{"token": null}', "{" * 5000, "\ud800"])
def test_what_is_no_token_is_refused(body: str) -> None:
    assert ask("POST", PAGE, content=body.encode(errors="surrogatepass")).status_code == 403


def test_the_logo_comes_from_this_server() -> None:
    answer = ask("GET", LOGO)
    assert answer.headers["content-type"] == "image/svg+xml"
    assert answer.text.startswith("<svg")
