"""Translates HTTP requests to operations: finds the operation of a path, reads members from path, query and body."""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin
from urllib.parse import parse_qs, unquote

from starlette.responses import Response

from ...schemas.wire.common import shorten
from ...schemas.wire.errors import InvalidParameterException
from ...schemas.wire.json_values import load_strict
from ...schemas.wire.operation_shape import OperationShape
from ...schemas.wire.request_problems import nearest
from .protocol_errors import (
    MethodNotAllowedException,
    SerializationException,
    UnknownOperationException,
    UnsupportedMediaTypeException,
)
from .service_requests import ServiceRequest

_MEMBER = re.compile(r"\{(\w+)\}")

ByMethod = dict[str, OperationShape]


@dataclass(frozen=True)
class Route:
    """An API operation found for a request, with the members in its path."""

    operation: OperationShape
    members: Mapping[str, str] = field(default_factory=dict)


class Router:
    """Finds the API operation of a request by HTTP method and path.

    A member takes all the rest of its path: an ARN arrives with its slashes encoded, or, in requests written by hand,
    without.
    """

    def __init__(self, operations: Iterable[OperationShape]) -> None:
        self._exact: dict[str, ByMethod] = {}
        patterns: dict[str, ByMethod] = {}
        for operation in operations:
            plain = "{" not in operation.path
            by_method = (self._exact if plain else patterns).setdefault(operation.path, {})
            by_method[operation.method] = operation
        self._patterns = [(re.compile(_MEMBER.sub(r"(?P<\1>.+)", path)), ops) for path, ops in patterns.items()]

    def find(self, method: str, raw_path: str) -> Route:
        """Finds the API operation that a request asks for.

        Args:
            method: HTTP method.
            raw_path: The path as it was sent; members in it are decoded once.

        Raises:
            UnknownOperationException: No operation has this path, or none with this method.
            SerializationException: A member in the path is not UTF-8.
        """
        by_method, members = self._at(raw_path)
        if (operation := by_method.get(method)) is None:
            allowed = tuple(sorted(by_method))
            raise MethodNotAllowedException(
                f"{raw_path} takes {' and '.join(allowed)}, but the request's method is {method}", allowed
            )
        return Route(operation, {name: _decoded(name, value) for name, value in members.items()})

    def _at(self, raw_path: str) -> tuple[ByMethod, Mapping[str, str]]:
        if (by_method := self._exact.get(raw_path)) is not None:
            return by_method, {}
        for pattern, by_method in self._patterns:
            if match := pattern.fullmatch(raw_path):
                return by_method, match.groupdict()
        shown = raw_path if len(raw_path) <= 100 else f"{raw_path[:100]}…"
        raise UnknownOperationException(f"there is no operation at {shown!r}{nearest(raw_path[:200], self._exact)}")


def _decoded(name: str, value: str) -> str:
    try:
        return unquote(value, errors="strict")
    except UnicodeDecodeError:
        raise SerializationException(f"{name} in the path is {value[:100]!r}, which is not encoded as UTF-8") from None


MAX_BODY_BYTES = 10 * 1024 * 1024
"""Largest request body in bytes; a batch of 1000 ordinary requests has some 2 MiB."""

MAX_MESSAGE_CHARACTERS = 4096
_MAX_QUERY_MEMBERS = 1000
_JSON_TYPES = frozenset({"application/json", "application/x-amz-json-1.0", "application/x-amz-json-1.1"})


def request_members(route: Route, request: ServiceRequest) -> dict[str, Any]:
    """Collects the members of an operation's request from path, query and body.

    Args:
        route: The operation, with the members in the path.
        request: The rest.

    Raises:
        SerializationException: Query or body cannot be read.
        UnsupportedMediaTypeException: The body is not JSON.
        InvalidParameterException: A member is in the body that belongs elsewhere.
    """
    operation = route.operation
    members: dict[str, Any] = dict(route.members)
    in_query = [name for name, location in operation.locations.items() if location == "querystring"]
    if in_query:
        members |= _query_members(operation, in_query, request.raw_query)
    if operation.request.model_fields.keys() <= operation.locations.keys():
        return members  # no member is left for a body; its content has no meaning
    body = _body_members(request)
    for name in operation.locations:
        if name in body:
            raise InvalidParameterException(f"{name} belongs into the {_place(operation, name)}, not into the body")
    return members | body


def _place(operation: OperationShape, name: str) -> str:
    return "path" if operation.locations[name] == "uri" else "query"


def _query_members(operation: OperationShape, names: list[str], query: str) -> dict[str, Any]:
    try:
        values = parse_qs(query, keep_blank_values=True, errors="strict", max_num_fields=_MAX_QUERY_MEMBERS)
    except UnicodeDecodeError:
        raise SerializationException("the query is not encoded as UTF-8") from None
    except ValueError:
        raise SerializationException(f"the query has more than {_MAX_QUERY_MEMBERS} members") from None
    fields = operation.request.model_fields
    # In a query, the name of a list is repeated; of anything else, the first counts.
    return {
        name: values[name] if _is_list(fields[name].annotation) else values[name][0] for name in names if name in values
    }


def _is_list(annotation: Any) -> bool:
    origin = get_origin(annotation)
    return origin is list or (origin in (Annotated, Union, UnionType) and any(map(_is_list, get_args(annotation))))


def _body_members(request: ServiceRequest) -> dict[str, Any]:
    if not request.content:
        return {}
    _check_content_type(request.headers.get("content-type"))
    try:
        text = request.content.decode()
    except UnicodeDecodeError as error:
        raise SerializationException(f"the body is not UTF-8: {error.reason} at byte {error.start}") from None
    try:
        document = load_strict(text, "the body", MAX_BODY_BYTES)
    except InvalidParameterException as error:
        raise SerializationException(str(error)) from None
    if not isinstance(document, dict):
        raise SerializationException(f"the body is {_kind(document)}; it has to be a JSON object")
    return document


def _check_content_type(content_type: str | None) -> None:
    """Checks that a body is JSON by its `Content-Type`: SDKs send `application/json` or no type.

    Raises UnsupportedMediaTypeException for any other type.
    """
    if content_type is None:
        return
    kind = content_type.partition(";")[0].strip().lower()
    if kind and kind not in _JSON_TYPES:
        raise UnsupportedMediaTypeException(f"Content-Type is {kind[:100]!r}; it has to be application/json")


def _kind(document: Any) -> str:
    kinds = {str: "text", bool: "true or false", int: "a number", float: "a number", list: "an array"}
    return kinds.get(type(document), "null")


class WireResponse(Response):
    """HTTP response with JSON as the AWS service sends it."""

    media_type = "application/json"

    def render(self, content: Mapping[str, Any]) -> bytes:
        """Serialises the response's members to JSON, in ASCII as AWS does."""
        return json.dumps(content, separators=(",", ":"), default=_seconds, allow_nan=False).encode()


def error_response(code: str, status: int, message: str) -> WireResponse:
    """Makes an error response in the form that AWS SDKs read.

    Args:
        code: The error's name.
        status: HTTP status.
        message: Text of the error; shortened for logs.
    """
    members = {"__type": code, "message": shorten(message, MAX_MESSAGE_CHARACTERS)}
    return WireResponse(members, status, {"x-amzn-errortype": code})


def _seconds(value: object) -> float:
    """Converts a time to seconds since 1970, rounded to milliseconds as AWS sent it.

    Raises TypeError if the value is no `datetime`.
    """
    if isinstance(value, datetime):
        return round(value.timestamp(), 3)
    raise TypeError(f"{value!r} has no JSON form")
