"""Reads the fields of submitted web forms, also of those with a file."""

import re
from collections.abc import Iterator
from urllib.parse import parse_qs

from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request

from ...endpoint.protocol_errors import RequestEntityTooLargeException, SerializationException
from ...endpoint.request_bodies import SMALL_BODY_TIMEOUT_S, read_body
from ...endpoint.service_requests import ServiceRequest

MOST_BYTES = 512 * 1024
"""Limit of a form's size in bytes: specifications of thousands of lines; more jobs are written with `forEach`."""

_MOST_FIELDS = 400
_MOST_HEAD_BYTES = 1024
_BOUNDARY = re.compile(r'multipart/form-data;[ \t]*boundary="?([\w\'()+,./:=?-]{1,70})"?[ \t]*', re.IGNORECASE)
_VALUE = rb'(?:"([^"\r\n]*)"|([^\s;"]+))'
_DISPOSITION = re.compile(
    rb"\r\ncontent-disposition:[ \t]*form-data;[ \t]*name=%b(?:;[ \t]*filename=%b)?[ \t]*(?:\r\n|\Z)"
    % (_VALUE, _VALUE),
    re.IGNORECASE,
)
"""Pattern of a `Content-Disposition` header as browsers write it.

Parsers of all that mail headers may contain take seconds for a few kilobytes.
"""


async def read_fields(request: Request, most_bytes: int = MOST_BYTES) -> dict[str, str]:
    """Reads the fields of a submitted web form, with uploaded files as text.

    Raises:
        ProtocolError: The form is too long, was not sent in time, or cannot be read.
    """
    whole = ServiceRequest(request.scope, request.receive)
    kind = request.headers.get("content-type", "")
    try:
        body = await read_body(whole, request.headers.get("content-length"), most_bytes, SMALL_BODY_TIMEOUT_S)
    except RequestEntityTooLargeException:
        raise RequestEntityTooLargeException(f"the form may have at most {most_bytes // 1024} KB") from None
    except ClientDisconnect:
        return {}
    return await run_in_threadpool(_fields, kind, body)  # long ones take some milliseconds


def _fields(kind: str, body: bytes) -> dict[str, str]:
    if kind.lower().startswith("multipart/"):
        fields: dict[str, str] = {}
        for name, value in _of_parts(kind, body):
            fields.setdefault(name, value)
        return fields
    try:
        values = parse_qs(body.decode(errors="replace"), keep_blank_values=True, max_num_fields=_MOST_FIELDS)
    except ValueError:
        raise _too_many() from None
    return {name: first for name, (first, *_) in values.items()}


def _of_parts(kind: str, body: bytes) -> Iterator[tuple[str, str]]:
    boundary = _BOUNDARY.fullmatch(kind)
    if boundary is None:
        raise SerializationException("content-type: a form has multipart/form-data; boundary=…, as browsers send it")
    _, *parts = (b"\r\n" + body).split(b"\r\n--" + boundary[1].encode(), _MOST_FIELDS + 2)
    if len(parts) > _MOST_FIELDS + 1:
        raise _too_many()
    if not parts or not parts.pop().startswith(b"--"):
        raise SerializationException("the form has no end")
    for part in parts:
        head, gap, content = part.partition(b"\r\n\r\n")
        found = _DISPOSITION.search(head) if gap and len(head) <= _MOST_HEAD_BYTES else None
        if found is None:
            raise SerializationException("the form has a part without a name that can be read")
        name, filename = (_text(found[each] or found[each + 1] or b"") for each in (1, 3))
        yield name, _text(content)
        if filename:
            yield f"{name}.name", filename


def _text(content: bytes) -> str:
    return content.decode("utf-8-sig", errors="replace")


def _too_many() -> SerializationException:
    return SerializationException(f"the form has more than {_MOST_FIELDS} fields")
