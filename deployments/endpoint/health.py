"""The pages for people and for watchdogs: `GET /` and `GET /health`."""

import json
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from ...tasks.service.service import Service
from .messages import HttpAnswer, HttpRequest, MethodNotAllowedException

_METHODS = ("GET", "HEAD")
_PAGE_HEADERS = (
    (
        b"content-security-policy",
        b"default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'",
    ),
    (b"cache-control", b"no-store"),
)


class HealthPages:
    """Says how the service is.

    Args:
      service: what is looked at.
      performer_status: how whoever carries jobs out is; plain JSON.
      is_open: whether anybody may see what the service holds; otherwise only that it works.
    """

    def __init__(
        self, service: Service, performer_status: Callable[[], Mapping[str, object]], *, is_open: bool
    ) -> None:
        self._service = service
        self._performer_status = performer_status
        self._is_open = is_open

    def answer(self, request: HttpRequest) -> HttpAnswer | None:
        """The page at a path; `None` if there is none.

        Raises:
          ServiceUnavailableException: the catalog does not answer.
          MethodNotAllowedException: pages are only read.
        """
        if request.raw_path not in ("/", "/health"):
            return None
        if request.method not in _METHODS:
            raise MethodNotAllowedException(f"{request.raw_path} can only be read", _METHODS)
        # The catalog is asked in any case: without it nothing works.
        facts: dict[str, Any] = {"status": "ok", "resources": self._service.catalog.count()}
        if self._is_open:
            settings = self._service.settings
            facts |= {"region": settings.region, "account": settings.account, "performer": self._performer_status()}
        else:
            del facts["resources"]
        if request.raw_path == "/health":
            body = json.dumps(facts, default=str).encode()
            return HttpAnswer(200, body, headers=((b"cache-control", b"no-store"),))
        host = request.header("host") or "localhost"
        return HttpAnswer(200, _page(facts, f"http://{host}").encode(), b"text/html; charset=utf-8", _PAGE_HEADERS)


def _page(facts: Mapping[str, Any], url: str) -> str:
    rows = [
        (kind, sum(counts.values()), ", ".join(f"{count} {status}" for status, count in counts.items() if status))
        for kind, counts in sorted(facts.get("resources", {}).items())
    ]
    return _template().render(facts=facts, rows=rows, url=url)


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader(__package__ or "", ""), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return environment.get_template("page.html.j2")
