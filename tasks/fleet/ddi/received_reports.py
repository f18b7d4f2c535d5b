"""Reports of robots that the server has received, for the rollout and the catalog.

A report may come twice, when a robot did not see the answer, so it must be possible to apply it repeatedly.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal, TypeVar

from ....schemas.wire.errors import InvalidParameterException

MAX_DETAILS = 50
"""Limit of the details (text lines) of one feedback message of a robot."""

MAX_DETAIL_CHARACTERS = 512
"""Limit of the characters of a detail in a robot's feedback; of a longer one, the beginning is kept."""

MAX_ATTRIBUTES = 100
MAX_ATTRIBUTE_CHARACTERS = 128
"""Limit on the characters of an attribute's name, and of its value."""

_MAX_NUMBER = 2**31 - 1
_SHOWN = 60


class Execution(StrEnum):
    """State of an update order, as the robot reports it."""

    CLOSED = "closed"
    PROCEEDING = "proceeding"
    CANCELED = "canceled"
    SCHEDULED = "scheduled"
    REJECTED = "rejected"
    RESUMED = "resumed"
    DOWNLOAD = "download"
    DOWNLOADED = "downloaded"


class Finished(StrEnum):
    """Result of an update order, which the robot reports once `Execution` is closed."""

    SUCCESS = "success"
    FAILURE = "failure"
    NONE = "none"


class OrderEnd(StrEnum):
    """End of an update order to a robot."""

    FINISHED = "finished"
    FAILED = "failed"
    CANCELED = "canceled"


@dataclass(frozen=True)
class Feedback:
    """A message of a robot about one update order."""

    action_id: int
    execution: Execution
    finished: Finished
    count: int | None = None
    """Number of an installation's steps that are done, as the robot reports it."""

    of: int | None = None
    """Number of all steps of an installation, as the robot reports it."""

    code: int | None = None
    """Failure code that the project's own agent reports; `None` for third-party updaters, which send none."""

    details: tuple[str, ...] = ()

    @property
    def order_end(self) -> OrderEnd | None:
        """End of the order, according to this message about the order; `None` if it has not ended."""
        if self.execution is Execution.CANCELED:
            return OrderEnd.CANCELED
        if self.execution is not Execution.CLOSED:
            return None
        return OrderEnd.FAILED if self.finished is Finished.FAILURE else OrderEnd.FINISHED

    @property
    def cancel_end(self) -> OrderEnd | None:
        """End of the order, according to this message about its cancellation; `None` if it has not ended."""
        if self.execution not in (Execution.CLOSED, Execution.CANCELED):
            return None
        return OrderEnd.FAILED if self.finished is Finished.FAILURE else OrderEnd.CANCELED


@dataclass(frozen=True)
class Attributes:
    """Attributes that a robot reports about itself, and how they change earlier ones."""

    mode: Literal["merge", "replace", "remove"]
    values: dict[str, str]


def parse_feedback(action_id: int, body: bytes) -> Feedback:
    """Parses a robot's feedback about an update order.

    Args:
        action_id: The order that the address names; the body's own `id` is ignored.
        body: JSON in UTF-8.

    Raises:
        InvalidParameterException: The content is not such JSON; the message names the member, its value, and what would
            be right.
    """
    status = _member(_document(body), "status", dict, "")
    result = _member(status, "result", dict, "status.")
    progress = _optional(result, "progress", dict, "status.result.") or {}
    return Feedback(
        action_id,
        _word(status, "execution", Execution, "status."),
        _word(result, "finished", Finished, "status.result."),
        _number(progress, "cnt", "status.result.progress.", 0),
        _number(progress, "of", "status.result.progress.", 0),
        _number(status, "code", "status.", -_MAX_NUMBER),
        _details(status),
    )


def parse_attributes(body: bytes) -> Attributes:
    """Parses the attributes that a robot reports about itself (`configData`).

    Args:
        body: JSON in UTF-8.

    Raises:
        InvalidParameterException: The content is not such JSON; the message names the member, its value, and what would
            be right.
    """
    document = _document(body)
    mode = document.get("mode") or "merge"
    if mode not in ("merge", "replace", "remove"):
        raise _wrong("mode", mode, "'merge', 'replace' or 'remove'")
    data = _member(document, "data", dict, "")
    if len(data) > MAX_ATTRIBUTES:
        raise InvalidParameterException(f"data: {len(data)} attributes; at most {MAX_ATTRIBUTES} are kept")
    for name, value in data.items():
        if not isinstance(value, str):
            raise _wrong(f"data.{name[:_SHOWN]}", value, "a text")
        if not name or max(len(name), len(value)) > MAX_ATTRIBUTE_CHARACTERS:
            right = f"a name and a value of at most {MAX_ATTRIBUTE_CHARACTERS} characters"
            raise _wrong(f"data.{name[:_SHOWN]}", value, right)
    return Attributes(mode, {_clean(name): _clean(value) for name, value in data.items()})


def _document(body: bytes) -> dict[str, Any]:
    try:
        document = json.loads(body.decode())
    except (ValueError, RecursionError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise InvalidParameterException(f"the body is no JSON in UTF-8: {reason}") from None
    if not isinstance(document, dict):
        raise _wrong("the body", document, "an object")
    return document


Kind = TypeVar("Kind", dict[str, Any], list[Any])
Word = TypeVar("Word", Execution, Finished)
_KINDS = {dict: "an object", list: "a list"}


def _optional(document: dict[str, Any], name: str, kind: type[Kind], where: str) -> Kind | None:
    value = document.get(name)
    if value is not None and not isinstance(value, kind):
        raise _wrong(where + name, value, _KINDS[kind])
    return value


def _member(document: dict[str, Any], name: str, kind: type[Kind], where: str) -> Kind:
    value = _optional(document, name, kind, where)
    if value is None:
        raise _missing(where + name, _KINDS[kind])
    return value


def _word(document: dict[str, Any], name: str, words: type[Word], where: str) -> Word:
    value = document.get(name)
    right = "one of " + ", ".join(repr(word.value) for word in words)
    if value is None:
        raise _missing(where + name, right)
    if not isinstance(value, str) or value not in {word.value for word in words}:
        raise _wrong(where + name, value, right)
    return words(value)


def _number(document: dict[str, Any], name: str, where: str, least: int) -> int | None:
    value = document.get(name)
    if value is None:
        return None
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= _MAX_NUMBER:
        raise _wrong(where + name, value, f"a whole number from {least} to {_MAX_NUMBER}")
    return value


def _details(status: dict[str, Any]) -> tuple[str, ...]:
    details = _optional(status, "details", list, "status.") or []
    if len(details) > MAX_DETAILS:
        raise InvalidParameterException(
            f"status.details: {len(details)} texts; at most {MAX_DETAILS} are taken at once"
        )
    for number, detail in enumerate(details):
        if not isinstance(detail, str):
            raise _wrong(f"status.details[{number}]", detail, "a text")
    return tuple(_clean(detail)[:MAX_DETAIL_CHARACTERS] for detail in details)


def _clean(text: str) -> str:
    """Removes characters that databases or terminals refuse: lone surrogates and control characters."""
    return "".join(
        "\ufffd" if "\ud800" <= each <= "\udfff" or (each < " " and each not in "\n\t") else each for each in text
    )


def _missing(where: str, right: str) -> InvalidParameterException:
    return InvalidParameterException(f"{where} is missing; {right} is right")


def _wrong(where: str, value: object, right: str) -> InvalidParameterException:
    return InvalidParameterException(f"{where}: {ascii(value)[:_SHOWN]} is not right; it has to be {right}")


@dataclass(frozen=True)
class OrderFetched:
    """Report: a robot read its update order for the first time."""

    robot: str
    action_id: int
    at_s: float
    """Time of a robot's report, in seconds since 1970."""


@dataclass(frozen=True)
class OrderFeedback:
    """Report: a robot's progress with its update order, or how the order ended (`Feedback.order_end`)."""

    robot: str
    feedback: Feedback
    at_s: float


@dataclass(frozen=True)
class CancelFeedback:
    """Report: a robot's answer to the cancellation of its order, which is cancelled or continues."""

    robot: str
    feedback: Feedback
    at_s: float


@dataclass(frozen=True)
class AttributesSent:
    """Report: a robot sent its attributes."""

    robot: str
    attributes: Attributes
    at_s: float


@dataclass(frozen=True)
class RobotsSeen:
    """Report: the last poll times of robots, gathered over some seconds (seconds since 1970, by robot)."""

    last_seen_s: Mapping[str, float]


RobotReport = OrderFetched | OrderFeedback | CancelFeedback | AttributesSent | RobotsSeen
