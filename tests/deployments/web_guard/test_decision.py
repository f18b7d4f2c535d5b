"""Which requests count as those of other web pages."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.deployments.foreign_pages import Refusal, is_loopback_host, refusal

OWN = "127.0.0.1:4200"
NAVIGATION = {"sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}


def decide(headers: dict[str, str] | list[tuple[str, str]], kind: str = "http", method: str = "POST") -> Refusal | None:
    pairs = headers.items() if isinstance(headers, dict) else headers
    raw = [(name.encode(), value.encode("latin-1")) for name, value in pairs]
    return refusal(kind, method, raw, is_loopback_host)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    "headers",
    [
        {"host": OWN},
        {"host": "localhost:4200"},
        {"host": "LOCALHOST"},
        {"host": OWN, "origin": f"http://{OWN}"},
        {"host": OWN, "origin": f"http://{OWN}", "sec-fetch-site": "same-origin"},
        {"host": OWN, "sec-fetch-site": "none"},
    ],
)
def test_programs_and_own_pages_pass(headers: dict[str, str], kind: str) -> None:
    assert decide(headers, kind) is None


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 400),
        ([("host", OWN), ("host", OWN)], 400),
        ({"host": "evil.example:4200"}, 400),
        ({"host": "127.0.0.1.evil.example:4200"}, 400),
        ({"host": "localhost.evil.example"}, 400),
        ({"host": "evil.example@127.0.0.1"}, 400),
        ({"host": "127.0.0.1:80:evil"}, 400),
        ({"host": ""}, 400),
        ({"host": OWN, "origin": "http://evil.example"}, 403),
        ({"host": OWN, "origin": "null"}, 403),
        ({"host": OWN, "origin": ""}, 403),
        ({"host": OWN, "origin": "http://127.0.0.1:4201"}, 403),
        ({"host": OWN, "origin": "http://localhost:4200"}, 403),
        ({"host": OWN, "origin": f"https://{OWN}"}, 403),
        ([("host", OWN), ("origin", f"http://{OWN}"), ("origin", "http://evil.example")], 403),
        ({"host": OWN, "sec-fetch-site": "cross-site"}, 403),
        ({"host": OWN, "sec-fetch-site": "same-site"}, 403),
        ({"host": OWN, "sec-fetch-site": "something-new"}, 403),
        ([("host", OWN), ("sec-fetch-site", "none"), ("sec-fetch-site", "cross-site")], 403),
        ({"host": OWN, "origin": f"http://{OWN}", "sec-fetch-site": "same-site"}, 403),
    ],
)
def test_other_pages_are_refused(headers: dict[str, str] | list[tuple[str, str]], status: int, kind: str) -> None:
    refused = decide(headers, kind)

    assert refused is not None
    assert refused.status == status


@pytest.mark.parametrize("site", ["same-site", "cross-site"])
def test_a_link_may_lead_to_us(site: str) -> None:
    headers = {"host": OWN, "sec-fetch-site": site, **NAVIGATION}

    assert decide(headers, method="GET") is None
    assert decide(headers, method="POST") is not None, "a form"
    assert decide({**headers, "sec-fetch-dest": "iframe"}, method="GET") is not None, "a frame"
    assert decide({**headers, "sec-fetch-mode": "no-cors"}, method="GET") is not None
    assert decide(headers, "websocket", "GET") is not None


@given(origin=st.text(st.characters(max_codepoint=255)), method=st.sampled_from(["GET", "POST", "DELETE", "OPTIONS"]))
def test_only_ones_own_origin_passes(origin: str, method: str) -> None:
    assert (decide({"host": OWN, "origin": origin}, method=method) is None) == (origin.strip() == f"http://{OWN}")
