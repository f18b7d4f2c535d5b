"""Strict parsing of JSON from untrusted sources, and type checks of its values."""

import json
from collections import Counter
from collections.abc import Mapping
from typing import Any, TypeGuard

from .errors import InvalidParameterException


def is_object(value: object) -> TypeGuard[dict[str, Any]]:
    """Whether a parsed JSON value is an object; its keys are text."""
    return isinstance(value, dict)


def is_mapping(value: object) -> TypeGuard[Mapping[Any, Any]]:
    """Whether a value is a mapping; unlike parsed JSON, one of a Python caller may have keys of any type."""
    return isinstance(value, Mapping)


def is_list(value: object) -> TypeGuard[list[Any]]:
    """Whether a parsed JSON value is a list."""
    return isinstance(value, list)


MAX_DEPTH = 32
"""Maximum nesting depth of objects and arrays; twice what any document here needs."""

MAX_VALUES = 150_000
"""Maximum number of values in a document; a batch of 1,000 ordinary requests has about 70,000. With this limit, any
document is parsed, checked and rejected within a second on one core.
"""

_MAX_SHOWN_CHARACTERS = 60


def load_strict(text: str, what: str, max_characters: int) -> Any:
    """Parses JSON from an untrusted source, with limits on size, nesting and numbers.

    Args:
        text: JSON text.
        what: Name of the parameter, for messages.
        max_characters: Maximum length of the text.

    Raises:
        InvalidParameterException: Too long, too many values, not JSON, duplicate members, NaN or Infinity, half of a
            surrogate pair, nested too deeply, or a number with thousands of digits.
    """
    if not 1 <= len(text) <= max_characters:
        raise InvalidParameterException(f"{what}: {len(text)} characters; 1 to {max_characters} would be right")
    # Before it is read, and so with commas in texts: no document that is right comes near.
    if (values := text.count(",") + text.count("[") + text.count("{")) > MAX_VALUES:
        raise InvalidParameterException(f"{what}: some {values} values; at most {MAX_VALUES} would be right")
    try:
        document = json.loads(text, object_pairs_hook=_unique, parse_constant=_refuse)
    except json.JSONDecodeError as error:
        raise InvalidParameterException(
            f"{what}: not JSON: {error.msg} at line {error.lineno}, column {error.colno}"
        ) from None
    except RecursionError:
        raise InvalidParameterException(f"{what}: nested more than {MAX_DEPTH} levels deep") from None
    except ValueError as error:
        # Either from above, or Python's own limit on the digits of an integer.
        message = "a number has too many digits" if str(error).startswith("Exceeds") else str(error)
        raise InvalidParameterException(f"{what}: {message}") from None
    if _is_deep(document):
        raise InvalidParameterException(f"{what}: nested more than {MAX_DEPTH} levels deep")
    try:
        json.dumps(document, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise InvalidParameterException(f"{what}: holds half of a surrogate pair, which is no character") from None
    return document


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    for name, count in Counter(name for name, _ in pairs).items():
        if count > 1:
            raise ValueError(f"member {show(name)} is there {count} times in one object; once would be right")
    return dict(pairs)


def _refuse(constant: str) -> Any:
    raise ValueError(f"{constant} is not a JSON number")


def _is_deep(document: Any) -> bool:
    """Returns whether objects and arrays are nested more than `MAX_DEPTH` times."""
    level = [document]
    for _ in range(MAX_DEPTH):
        level = [
            item
            for container in level
            if isinstance(container, dict | list)
            for item in (container.values() if isinstance(container, dict) else container)
        ]
    return bool(level)


def show(value: Any) -> str:
    """Formats a value as short printable text for an error message."""
    text = json.dumps(value, default=repr, ensure_ascii=False)
    text = text if text.isprintable() else json.dumps(value, default=repr)
    return text if len(text) <= _MAX_SHOWN_CHARACTERS else text[: _MAX_SHOWN_CHARACTERS - 4] + " ..."
