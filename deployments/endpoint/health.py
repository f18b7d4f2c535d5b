"""Pages for operators: status, health check, and metrics for Prometheus."""

import base64
import binascii
import hmac
import json
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib.metadata import version
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    Counter,
    Histogram,
    ProcessCollector,
    generate_latest,
)
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.responses import HTMLResponse, Response

from ...tasks.service.service import Service
from .calling.access_keys import AccessKey
from .protocol_errors import MethodNotAllowedException
from .service_requests import ServiceRequest

_METHODS = ("GET", "HEAD")
_HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'",
}


class HealthPages:
    """Health and status pages of the API server.

    Args:
        service: The service, with its catalog and object store.
        worker_status: Returns the job worker's status; plain JSON.
        is_open: Whether every client may see what the service holds; otherwise only that it works.
        console: Path of the console; `None`: there is none.
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
        """Returns the health page at a path; `None` if there is none.

        Args:
            request: The HTTP request.
            is_of_job: Whether a simulation job asks, which sees no more than that it works.

        Raises:
            ServiceUnavailableException: The catalog does not answer.
            MethodNotAllowedException: Pages are only read.
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


PATH = "/metrics"
_NO_OPERATION = "none"
"""Metric label of requests to paths without an operation: one for all, as clients choose paths."""

_BUCKETS_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)
"""Upper bounds of the histogram of request durations, in seconds.

A read takes 1 ms, a batch of 1,000 requests seconds.
"""


class Metrics:
    """Prometheus metrics of the API server: requests and resources.

    Args:
        service: The service, whose resources are counted when metrics are read.
        access_keys: Access keys by id. With them, metrics are read with id and secret of one that is not confined to
            some resources, by HTTP's basic authentication, since scrapers do not sign; `None`: by every client.
        worker_status: Returns the job worker's status.
    """

    def __init__(
        self,
        service: Service,
        access_keys: Mapping[str, AccessKey] | None,
        worker_status: Callable[[], Mapping[str, object]],
    ) -> None:
        self._access_keys = access_keys
        self._registry = CollectorRegistry()
        labels = ("operation", "status")
        self._requests = Counter(
            "robomaker_http_requests", "Requests that were answered.", labels, registry=self._registry
        )
        self._duration_s = Histogram(
            "robomaker_http_request_duration_seconds",
            "Time from a request's headers to its answer's last byte.",
            ("operation",),
            buckets=_BUCKETS_S,
            registry=self._registry,
        )
        self._registry.register(_Resources(service, worker_status))
        ProcessCollector(registry=self._registry)

    def count(self, operation: str | None, status: int, duration_s: float) -> None:
        """Counts one API request.

        Args:
            operation: The operation that it asked for; `None`: none.
            status: HTTP status of its answer.
            duration_s: Duration of the request, in seconds.
        """
        name = operation or _NO_OPERATION
        self._requests.labels(name, str(status)).inc()
        self._duration_s.labels(name).observe(duration_s)

    def answer(self, request: ServiceRequest) -> Response | None:
        """Returns the metrics page if the request asks for it.

        Raises:
            ServiceUnavailableException: The catalog does not answer.
            MethodNotAllowedException: The request's method is neither GET nor HEAD.
        """
        if request.raw_path != PATH:
            return None
        if request.method not in _METHODS:
            raise MethodNotAllowedException(f"{PATH} can only be read", _METHODS)
        if not self._may_read(request.headers.get("authorization", "")):
            words = "metrics are read with an access key's id and secret, by basic authentication\n"
            return Response(words, 401, {"www-authenticate": 'Basic realm="robomaker metrics"'}, "text/plain")
        headers = {"cache-control": "no-store"}
        return Response(generate_latest(self._registry), headers=headers, media_type=CONTENT_TYPE_LATEST)

    def _may_read(self, authorization: str) -> bool:
        if self._access_keys is None:
            return True
        scheme, _, encoded = authorization.partition(" ")
        try:
            given = base64.b64decode(encoded, validate=True).decode()
        except (binascii.Error, UnicodeDecodeError):
            return False
        key, _, secret = given.partition(":")
        known = self._access_keys.get(key)
        is_secret = hmac.compare_digest((known.secret if known else "").encode(), secret.encode())
        return scheme.lower() == "basic" and known is not None and is_secret and not known.is_confined


class _Resources(Collector):
    """Metrics collector that reads gauges from the catalog at each scrape, since other processes change it."""

    def __init__(self, service: Service, worker_status: Callable[[], Mapping[str, object]]) -> None:
        self._service = service
        self._worker_status = worker_status

    def collect(self) -> Iterator[Metric]:
        """Yields metrics of this server: resources by kind and status, the job worker's state and restarts, version.

        Metrics of the job worker are left out where this server has none.
        """
        resources = GaugeMetricFamily("robomaker_resources", "Resources in the catalog.", labels=("kind", "status"))
        for kind, counts in self._service.catalog.count().items():
            for status, count in counts.items():
                resources.add_metric((kind, status or ""), count)
        yield resources
        worker = self._worker_status()
        if "state" in worker:
            words = "Whether this server's job worker takes jobs; 0: it waits for the catalog or for Prefect."
            yield GaugeMetricFamily("robomaker_job_worker_ready", words, value=float(worker["state"] == "ready"))
        if isinstance(restarts := worker.get("restarts"), int):
            words = "How often this server's job worker died and was started again."
            yield CounterMetricFamily("robomaker_job_worker_restarts", words, value=float(restarts))
        build = GaugeMetricFamily("robomaker_build_info", "Which release this is.", labels=("version",))
        build.add_metric((version("prefect-robomaker"),), 1.0)
        yield build

    def describe(self) -> list[Metric]:
        """Returns nothing: metric names are not known before the catalog answers."""
        return []
