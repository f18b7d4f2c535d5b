"""Filters and pages of the List operations; `catalog/page_tokens.py` makes and checks the tokens of pages."""

from collections.abc import Sequence
from typing import Protocol

from ...schemas.wire.common import filter_values
from ...schemas.wire.errors import InvalidParameterException
from ...schemas.wire.request_problems import nearest
from ..catalog import Page
from ..service.service import Service


class ListRequest(Protocol):
    """A request of a List operation."""

    @property
    def nextToken(self) -> str | None:  # noqa: N802 - the service's name
        """Token of the page before."""
        ...

    @property
    def maxResults(self) -> int | None:  # noqa: N802 - the service's name
        """Entries per page."""
        ...


def page_of(
    request: ListRequest,
    kinds: str | Sequence[str],
    service: Service,
    *filters: str,
    most: int = 100,
    members: Sequence[str] | None = None,
) -> Page:
    """Reads the page of a list that a request asks for, newest first.

    Args:
        request: says how many entries, after which, and its filters; page tokens are good for its operation only.
        kinds: the kinds of resources that are listed.
        service: where the resources are stored.
        filters: names of the operation's filters: `name`, `status` or a label of the resource.
        most: entries per page, unless the request asks for fewer.
        members: which members of large documents are read; `None`: all.

    Raises:
        InvalidParameterException: a filter is not known, or the token is not of this list.
    """
    wanted: dict[str, Sequence[str]] = {}
    for name, values in filter_values(getattr(request, "filters", None)).items():
        if name not in filters:
            known = f"known are {', '.join(sorted(filters))}" if filters else "this list has none"
            raise InvalidParameterException(f"filters: {name!r} is not known{nearest(name, filters)}; {known}")
        wanted[name] = values
    return service.catalog.list(
        kinds,
        filters=wanted,
        limit=min(request.maxResults or most, most),
        after=request.nextToken,
        scope=type(request).__name__.removesuffix("Request"),
        members=members,
    )
