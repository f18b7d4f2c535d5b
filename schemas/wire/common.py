"""Simple shapes that several operations share: names, ARNs, places in the object store, pages.

Bounds, patterns and enumerations are those of AWS, with three intended differences:

- a pattern has to match the whole value;
- `.` in a pattern also matches a line break, since commands and failure reasons have several lines;
- bounds of a list apply to requests; in responses a list may be empty, or longer.
"""

import math
import re
import unicodedata
from collections.abc import Callable, Iterable, Sequence
from typing import Annotated, Literal, Protocol, Self, TypeVar

from pydantic import AfterValidator, AwareDatetime, BeforeValidator, Field, StringConstraints, model_validator

from .base import NamesWorld, Shape, ShapeName, optional

MAX_DURATION_S = 14 * 24 * 3600
"""Maximum duration of jobs and batches in seconds: 14 days."""


class Named(Protocol):
    """Interface of objects with a `name`."""

    @property
    def name(self) -> str:
        """Name of the object."""
        ...


_Named = TypeVar("_Named", bound=Named)


def text(minimum: int, maximum: int, pattern: str | None = None) -> StringConstraints:
    """Makes a pydantic constraint for strings: minimum and maximum length in characters, and a pattern.

    The pattern has to match the whole text; `None`: any characters.
    """
    return StringConstraints(
        min_length=minimum, max_length=maximum, pattern=None if pattern is None else f"^(?:{pattern})$"
    )


def _without_controls(name: str) -> str:
    found = sorted({each for each in name if unicodedata.category(each) == "Cc"})
    if found:
        shown = ", ".join(f"U+{ord(each):04X}" for each in found)
        raise ValueError(f"a name has no control characters; remove {shown}")
    return name


NO_CONTROLS = AfterValidator(_without_controls)
"""Validator that rejects names with control characters, which terminals and web pages would interpret."""


def unique_names(what: str) -> Callable[[list[_Named]], list[_Named]]:
    """Makes a pydantic validator that rejects lists with two items of the same name; `what` describes the items."""

    def check(entries: list[_Named]) -> list[_Named]:
        names = [entry.name for entry in entries]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"{what} names have to differ; {', '.join(map(repr, twice))} appears more than once")
        return entries

    return check


def raise_all(problems: Iterable[str]) -> None:
    """Raises one error with all problems that rules found, one line each, without duplicates.

    Args:
        problems: Texts, each beginning with the path of its member if it has one; without any, no error is raised.

    Raises:
        ValueError: There are problems.
    """
    if lines := dict.fromkeys(problems):
        raise ValueError("\n".join(lines))


_ESCAPE_SEQUENCE = re.compile(r"\x1b\[[0-9;?]*[ -/]*[@-~]|\x1b\][^\x07\x1b]*(?:\x07|\x1b\\)|[\x00-\x08\x0b-\x1f\x7f]")


def without_escapes(text: str) -> str:
    """Removes terminal escape sequences (colours, titles; ECMA-48) and other control characters from a text."""
    return _ESCAPE_SEQUENCE.sub("", text)


def counted(count: int, noun: str, form: str = "") -> str:
    """Returns a number with its noun, as `1 trial` or `2 trials`.

    Args:
        count: The number.
        noun: Word for one of them, whose plural ends with an s.
        form: Format of the number; `,` puts commas between thousands.
    """
    return f"{count:{form}} {noun}{'' if count == 1 else 's'}"


def passed_of(passed: int, total: int, noun: str, broke: int = 0) -> str:
    """Returns how many passed: `3 of 4 jobs passed`, where some broke `9 of 16 trials passed, 4 broke`.

    Args:
        passed: Number of those that passed.
        total: Number of all.
        noun: Word for one of them, whose plural ends with an s.
        broke: Number of those that broke.
    """
    return f"{passed} of {counted(total, noun)} passed{f', {broke} broke' if broke else ''}"


def shorten(reason: str, limit: int = 1024) -> str:
    """Shortens a failure reason to the length limit of the service: keeps the beginning and, if long, the end.

    Terminal escape sequences are removed.
    """
    reason = without_escapes(reason)
    if len(reason) <= limit:
        return reason
    mark = "\n[…]\n"
    head = math.ceil(limit / 3)
    return reason[:head] + mark + reason[-(limit - head - len(mark)) :]


# Plain values

Timestamp = Annotated[AwareDatetime, ShapeName("CreatedAt")]
"""Time with its time zone; in the API a number of seconds since 1970."""
LastStartedAt = Annotated[AwareDatetime, ShapeName("LastStartedAt")]
LastUpdatedAt = Annotated[AwareDatetime, ShapeName("LastUpdatedAt")]
FailedAt = Annotated[AwareDatetime, ShapeName("FailedAt")]

GenericString = Annotated[str, ShapeName("GenericString"), text(0, 1024)]
NonEmptyString = Annotated[str, ShapeName("NonEmptyString"), text(1, 255)]
Json = Annotated[str, ShapeName("Json"), text(1, 262144)]
Name = Annotated[str, ShapeName("Name"), text(1, 255, r"[a-zA-Z0-9_\-]*")]
Path = Annotated[str, ShapeName("Path"), text(1, 1024)]
Version = Annotated[str, ShapeName("Version"), text(1, 255, r"(\$LATEST)|[0-9]*")]
ClientRequestToken = Annotated[str, ShapeName("ClientRequestToken"), text(1, 64, r"[a-zA-Z0-9_\-=]*")]
JobDuration = Annotated[int, ShapeName("JobDuration", wire_type="long"), Field(ge=1, le=MAX_DURATION_S)]
Architecture = Annotated[Literal["X86_64", "ARM64", "ARMHF"], ShapeName("Architecture")]
MAX_SEED = 2**63 - 1
"""Maximum seed: the largest integer that databases, manifests and other programs can store."""
Seed = Annotated[int, ShapeName("Seed", wire_type="long"), Field(ge=0, le=MAX_SEED)]

# References

Arn = Annotated[str, ShapeName("Arn"), text(1, 1224, r"arn:.*")]
Arns = Annotated[list[Arn], ShapeName("Arns"), Field(min_length=1, max_length=100)]
AnsweredArns = Annotated[list[Arn], ShapeName("Arns", 1, 100)]
"""ARNs in a response, without a limit on their number."""
WorldArn = Annotated[Arn, NamesWorld()]
"""ARN of a world. Specifications also take its name, and its id or the beginning of that."""
WorldArns = Annotated[list[WorldArn], ShapeName("Arns"), Field(min_length=1, max_length=100)]
ApplicationReference = Annotated[str, ShapeName("ApplicationReference"), text(1, 1224, r"arn:.*|[a-zA-Z0-9_\-]+")]
"""ARN of an application or (an extension) its name alone."""

IamRole = Annotated[str, ShapeName("IamRole"), text(1, 255, r"arn:aws:iam::\w+:role/.*")]

# Object store

S3Bucket = Annotated[str, ShapeName("S3Bucket"), text(3, 63, r"[a-z0-9][a-z0-9.\-]*[a-z0-9]")]
S3Key = Annotated[str, ShapeName("S3Key"), text(1, 1024)]
S3KeyOrPrefix = Annotated[str, ShapeName("S3KeyOrPrefix"), text(0, 1024)]
S3Etag = Annotated[str, ShapeName("S3Etag")]


class OutputLocation(Shape):
    """Bucket and key prefix in the object store for a job's outputs."""

    s3Bucket: S3Bucket | None = optional("Bucket; absent: the configured one.")
    s3Prefix: S3Key | None = optional("Prefix of the keys of all outputs.")


def _none_if_empty(location: object) -> object:
    empty = location == {} or (isinstance(location, OutputLocation) and not location.model_dump(exclude_none=True))
    return None if empty else location


OptionalOutputLocation = Annotated[OutputLocation | None, BeforeValidator(_none_if_empty)]
"""Output location; clients may send `{}` for none."""

# Pages

PaginationToken = Annotated[str, ShapeName("PaginationToken"), text(1, 2048, r"[a-zA-Z0-9_.\-\/+=]*")]
MaxResults = Annotated[int, ShapeName("MaxResults"), Field(ge=1, le=100)]


class PageRequest(Shape):
    """Base class of requests for one page of a list: token of the page, and its size."""

    nextToken: PaginationToken | None = optional("Token of the page before, to go on after it.")
    maxResults: MaxResults | None = optional("Entries per page; absent: 100.")


class JobReference(Shape):
    """Base class of requests about one job: has the job's ARN."""

    job: Arn = Field(description="ARN of the job.")


class Filter(Shape):
    """A filter of a list request: a name and the accepted values."""

    name: Name | None = optional("Member to compare, such as `status`.")
    values: Annotated[list[Name], ShapeName("FilterValues"), Field(min_length=1, max_length=1)] | None = optional(
        "The value it has to be equal to; exactly one."
    )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.name is None or self.values is None:
            raise ValueError("a filter needs both name and values")
        return self


Filters = Annotated[list[Filter], ShapeName("Filters"), Field(min_length=1, max_length=1)]


def filter_values(filters: Sequence[Filter] | None) -> dict[str, list[str]]:
    """Converts a list request's filters to a mapping from name to accepted values.

    `None` is no filter. Filters without a name or without values are left out.
    """
    return {each.name: each.values for each in filters or () if each.name and each.values}


def exactly_one(members: tuple[str, str], given: tuple[object, object]) -> None:
    """Raises an error unless exactly one of two request members is given.

    Args:
        members: Names of the members.
        given: Values of the members, in the same order; `None` is absent.

    Raises:
        ValueError: None or both of the members are given.
    """
    present = sum(value is not None for value in given)
    if present != 1:
        found = "both are" if present else "neither is"
        raise ValueError(f"exactly one of {' and '.join(members)} has to be given, but {found}")
