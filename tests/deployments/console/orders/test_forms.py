"""Forms as they are sent: what browsers write is read, and nothing else keeps the server busy."""

import asyncio
from typing import Any

import pytest
from starlette.requests import Request

from prefect_robomaker.deployments.console.orders.forms import read_fields
from prefect_robomaker.deployments.endpoint.protocol_errors import ProtocolError

KIND = "multipart/form-data; boundary=----WebKitFormBoundaryX"


def part(disposition: str, content: str = "v") -> str:
    """A part of a form, with its boundary before it."""
    return f"------WebKitFormBoundaryX\r\nContent-Disposition: {disposition}\r\n\r\n{content}\r\n"


def fields(body: str, kind: str = KIND) -> dict[str, str]:
    """What is read of a form."""

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": body.encode(), "more_body": False}

    scope = {"type": "http", "headers": [(b"content-type", kind.encode())]}
    return asyncio.run(read_fields(Request(scope, receive)))


END = "------WebKitFormBoundaryX--\r\n"


def test_forms_of_browsers_are_read() -> None:
    file = 'form-data; name="file"; filename="mein Büro.yaml"\r\nContent-Type: application/yaml'
    parts = [
        part('form-data; name="text"', "a: 1\r\n\r\n--b"),
        part("form-data; name=text", "later"),
        part(file, "\ufeffü"),
    ]
    read = fields("".join(parts) + END)
    assert read == {"text": "a: 1\r\n\r\n--b", "file": "ü", "file.name": "mein Büro.yaml"}
    assert fields("a=1&b=%C3%BC&a=2&c=", "application/x-www-form-urlencoded") == {"a": "1", "b": "ü", "c": ""}
    assert fields(END) == {}


@pytest.mark.parametrize(
    ("body", "kind", "told"),
    [
        (part("form-data; name*") + END, KIND, "without a name"),
        (part("form-data; name=" + "(" * 3_000) + END, KIND, "without a name"),
        (part("form-data" + "; a=b" * 100_000) + END, KIND, "without a name"),
        (part('attachment; name="a"') + END, KIND, "without a name"),
        ("------WebKitFormBoundaryX\r\n" + END, KIND, "without a name"),
        (part('form-data; name="a"'), KIND, "no end"),
        ("", KIND, "no end"),
        (part('form-data; name="a"') * 401 + END, KIND, "more than 400 fields"),
        ("&a=1" * 401, "application/x-www-form-urlencoded", "more than 400 fields"),
        (END, "multipart/form-data", "content-type"),
        (END, "multipart/mixed; boundary=----WebKitFormBoundaryX", "content-type"),
        ("a" * 600_000, KIND, "at most 512 KB"),
    ],
    ids=[str(number) for number in range(12)],
)
def test_what_is_no_form_of_a_browser_is_refused(body: str, kind: str, told: str) -> None:
    with pytest.raises(ProtocolError, match=told):
        fields(body, kind)
