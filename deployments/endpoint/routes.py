"""Finds the operation of a method and a path."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from urllib.parse import unquote

from ...schemas.wire.operation_shape import OperationShape
from ...schemas.wire.request_problems import nearest
from .messages import MethodNotAllowedException, SerializationException, UnknownOperationException

_MEMBER = re.compile(r"\{(\w+)\}")

ByMethod = dict[str, OperationShape]


@dataclass(frozen=True)
class Route:
    """An operation, and the members of its request that the path holds."""

    operation: OperationShape
    members: Mapping[str, str] = field(default_factory=dict)


class Router:
    """Finds operations by method and path.

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
        """Finds the operation that a request asks for.

        Args:
            method: HTTP method.
            raw_path: the path as it was sent; members in it are decoded once.

        Raises:
            UnknownOperationException: there is none at that path, or none with that method.
            SerializationException: a member in the path is not UTF-8.
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
