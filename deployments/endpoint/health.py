"""The status page and the health check: `GET /` and `GET /health`."""

import json
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from starlette.responses import HTMLResponse, Response

from ...tasks.service.service import Service
from .messages import MethodNotAllowedException, ServiceRequest

_METHODS = ("GET", "HEAD")
_HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'",
}


class HealthPages:
    """Says how the service is.

    Args:
        service: what is looked at.
        worker_status: returns the job worker's status; plain JSON.
        is_open: whether every client may see what the service holds; otherwise only that it works.
        console: path of the console; `None`: there is none.
    """

    def __init__(
        self,
        service: Service,
        worker_status: Callable[[], Mapping[str, object]],
        *,
        is_open: bool,
        console: str | None = None,
    ) -> None:
        self._service = service
        self._worker_status = worker_status
        self._is_open = is_open
        self._console = console

    def answer(self, request: ServiceRequest, *, is_of_job: bool = False) -> Response | None:
        """The page at a path; `None` if there is none.

        Args:
            request: what is asked.
            is_of_job: whether a simulation job asks, which sees no more than that it works.

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
        if self._is_open and not is_of_job:
            settings = self._service.settings
            facts |= {"region": settings.region, "account": settings.account, "performer": self._worker_status()}
        else:
            del facts["resources"]
        if request.raw_path == "/health":
            body = json.dumps(facts, default=str)
            return Response(body, headers={"cache-control": "no-store"}, media_type="application/json")
        host = request.headers.get("host") or "localhost"
        return HTMLResponse(_page(facts, f"http://{host}", self._console), headers=_HEADERS)


def _page(facts: Mapping[str, Any], url: str, console: str | None) -> str:
    rows = [
        (kind, sum(counts.values()), ", ".join(f"{count} {status}" for status, count in counts.items() if status))
        for kind, counts in sorted(facts.get("resources", {}).items())
    ]
    return _template().render(facts=facts, rows=rows, url=url, console=console)


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader(__package__ or "", ""), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return environment.get_template("page.html.j2")
