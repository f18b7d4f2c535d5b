"""Metrics for Prometheus: `GET /metrics`, and what is counted for it.

Names and units follow https://prometheus.io/docs/practices/naming/. Nothing is global: each endpoint counts its own.
"""

import base64
import binascii
import hmac
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version

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
from starlette.responses import Response

from ...tasks.service.service import Service
from .calling.access_keys import AccessKey
from .messages import MethodNotAllowedException, ServiceRequest

PATH = "/metrics"
_METHODS = ("GET", "HEAD")
_NO_OPERATION = "none"
"""The label of requests that came to no operation: one for all, as clients choose paths."""

_BUCKETS_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)
"""A read takes 1 ms, a batch of 1,000 requests seconds."""


class Metrics:
    """Counts requests, and shows them with what the catalog holds.

    Args:
        service: whose resources are counted when somebody asks.
        access_keys: access keys by id. With them, metrics are read with id and secret of one that is not confined to
            some resources, by HTTP's basic authentication, since scrapers do not sign; `None`: by every client.
        worker_status: what the job worker says of itself.
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
        """Counts one request.

        Args:
            operation: the operation that it asked for; `None`: none.
            status: HTTP status of its answer.
            duration_s: how long it took.
        """
        name = operation or _NO_OPERATION
        self._requests.labels(name, str(status)).inc()
        self._duration_s.labels(name).observe(duration_s)

    def answer(self, request: ServiceRequest) -> Response | None:
        """The metrics, if the request is for them.

        Raises:
            ServiceUnavailableException: the catalog does not answer.
            MethodNotAllowedException: they are only read.
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
    """Gauges that are read from the catalog at each scrape, since other processes change it."""

    def __init__(self, service: Service, worker_status: Callable[[], Mapping[str, object]]) -> None:
        self._service = service
        self._worker_status = worker_status

    def collect(self) -> Iterator[Metric]:
        """Yields gauges of resources, of the job worker, and of the version."""
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
        """Nothing: the registry asks for names when a collector is added, and the catalog may be away then."""
        return []
