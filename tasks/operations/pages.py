"""Filters and pages of the List operations; `catalog/page_tokens.py` makes and checks the tokens of pages."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from ...schemas.wire.common import Filter, filter_values
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
    operation: str,
    kinds: str | Sequence[str],
    request: ListRequest,
    service: Service,
    *,
    filters: Mapping[str, str],
    given: Sequence[Filter] | None = None,
    most: int = 100,
    members: Sequence[str] | None = None,
) -> Page:
    """Reads the page of a list that a request asks for, newest first.

    Args:
        operation: the List operation's name; page tokens are good for it only.
        kinds: the kinds of resources that are listed.
        request: says how many entries, and after which.
        service: where the resources are stored.
        filters: for each filter name of the operation, what of the resource it compares: `name`,
            `status`, `parent` or a label.
        given: the request's filters.
        most: entries per page, unless the request asks for fewer.
        members: which members of large documents are read; `None`: all.

    Raises:
        InvalidParameterException: a filter is not known, or the token is not of this list.
    """
    wanted: dict[str, Sequence[str]] = {}
    for name, values in filter_values(given).items():
        if name not in filters:
            known = f"known are {', '.join(sorted(filters))}" if filters else "this list has none"
            raise InvalidParameterException(f"filters: {name!r} is not known{nearest(name, filters)}; {known}")
        wanted[filters[name]] = values
    return service.catalog.list(
        kinds,
        filters=wanted,
        limit=min(request.maxResults or most, most),
        after=request.nextToken,
        scope=operation,
        members=members,
    )
