"""A real server, and real connections to it."""

import asyncio
import http.client
import json
import logging
import signal
import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from botocore.auth import SigV4Auth
from botocore.awsrequest import AWSRequest
from botocore.credentials import Credentials
from helpers.endpoint_here import endpoint_here
from helpers.endpoint_server import exchange, http_request

from prefect_robomaker.deployments.endpoint.application import LOGGER, Endpoint, write_access_log
from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.deployments.endpoint.server import listening, run_server
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.service.service import Service

CLIENTS = 8
NAMES = 6


def ask(
    port: int, method: str, target: str, body: bytes = b"", **headers: str
) -> tuple[int, http.client.HTTPMessage, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=200)
    connection.request(method, target, body, {name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, answer.headers, content


def test_what_boto3_sends_is_served(service: Service, template: str) -> None:
    keys = {"AKIAEXAMPLE": AccessKey("AKIAEXAMPLE", "secret")}
    with endpoint_here(Endpoint(service, access_keys=keys)) as port:

        def sent(method: str, target: str, body: bytes, secret: str = "secret") -> tuple[int, Any, Any]:
            url = f"http://localhost:{port}{target}"
            headers = {"User-Agent": "Boto3/1.40.60 md/Botocore#1.40.60"}
            if body:
                headers["Content-Type"] = "application/json"
            request = AWSRequest(method=method, url=url, data=body, headers=headers)
            SigV4Auth(Credentials("AKIAEXAMPLE", secret), "robomaker", "us-east-1").add_auth(request)
            connection = http.client.HTTPConnection("localhost", port, timeout=200)
            connection.request(method, target, body, dict(request.headers.items()))
            answer = connection.getresponse()
            content = json.loads(answer.read())
            connection.close()
            return answer.status, answer.headers, content

        status, headers, described = sent("POST", "/describeWorldTemplate", json.dumps({"template": template}).encode())
        assert (status, described["arn"]) == (200, template)
        assert headers["date"]
        assert headers["x-amzn-RequestId"]
        assert headers["server"] is None
        tags = f"/tags/{quote(template, safe='')}"
        assert sent("POST", tags, b'{"tags": {"a b": "1", "c:d": "2"}}')[::2] == (200, {})
        assert sent("DELETE", f"{tags}?tagKeys=a%20b&tagKeys=x%3Ay", b"")[::2] == (200, {})
        assert sent("GET", tags, b"")[::2] == (200, {"tags": {"c:d": "2"}})
        status, headers, refused = sent("POST", "/listWorlds", b"{}", secret="wrong")
        assert (status, refused["__type"], headers["x-amzn-ErrorType"]) == (403, *["InvalidSignatureException"] * 2)


def test_of_several_clients_one_gets_a_name(service: Service) -> None:
    together = threading.Barrier(CLIENTS)

    def create(port: int, name: str) -> tuple[int, dict[str, Any]]:
        request = {"name": name, "robotSoftwareSuite": {"name": "General"}, "environment": {"uri": "python://a.b"}}
        together.wait()
        status, _, body = ask(port, "POST", "/createRobotApplication", json.dumps(request).encode())
        return status, json.loads(body)

    with endpoint_here(Endpoint(service)) as port, ThreadPoolExecutor(CLIENTS) as pool:
        for number in range(NAMES):
            answers = list(pool.map(create, [port] * CLIENTS, [f"robot-{number}"] * CLIENTS))
            refused = [body["__type"] for status, body in answers if status == 400]

            assert [status for status, _ in answers].count(200) == 1, answers
            assert refused == ["ResourceAlreadyExistsException"] * (CLIENTS - 1)


def test_connections_stay_open(service: Service) -> None:
    async def several(port: int) -> list[int]:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        paths = ["/listWorlds", "/makeCoffee", "/listWorlds"]
        statuses = [(await exchange(reader, writer, http_request(path, {})))[0] for path in paths]
        writer.close()
        await writer.wait_closed()
        return statuses

    with endpoint_here(Endpoint(service)) as port:
        assert asyncio.run(several(port)) == [200, 404, 200]


def test_connections_do_not_collect_small_packets() -> None:
    with (
        listening("127.0.0.1", 0) as listener,
        socket.create_connection(listener.getsockname()),
        listener.accept()[0] as connection,
    ):
        assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_a_body_that_is_too_long_is_refused_in_full(service: Service) -> None:
    with endpoint_here(Endpoint(service)) as port:
        status, _, body = ask(port, "POST", "/listWorlds", b" " * 30_000_000, content_type="application/json")

        assert (status, json.loads(body)["__type"]) == (413, "RequestEntityTooLargeException")


@pytest.mark.parametrize(
    "sent",
    [b"\x16\x03\x01\x02\x00\x01\x00", b"GET\r\n\r\n", b"POST /listWorlds HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n"],
)
def test_what_is_no_http_is_refused(sent: bytes, service: Service) -> None:
    with endpoint_here(Endpoint(service)) as port:
        with socket.create_connection(("127.0.0.1", port), timeout=200) as connection:
            connection.sendall(sent)
            connection.shutdown(socket.SHUT_WR)
            answer = b"".join(iter(lambda: connection.recv(65536), b""))
        assert answer.split(b" ", 2)[1:2] in ([b"400"], [b"403"])
        assert ask(port, "POST", "/listWorlds")[0] == 200


def test_a_port_that_is_taken(service: Service) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigurationError, match=f"cannot listen at 127.0.0.1 port {port}"):
            run_server(Endpoint(service), "127.0.0.1", port, ready=lambda port: None)


@pytest.mark.parametrize(("host", "port"), [("127.0.0.1", 70000), ("no such host", 0), ("192.0.2.1", 0)])
def test_places_where_nothing_can_listen(host: str, port: int, service: Service) -> None:
    with pytest.raises(ConfigurationError, match="cannot listen at"):
        run_server(Endpoint(service), host, port, ready=lambda port: None)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_it_and_handlers_are_put_back(number: signal.Signals, service: Service) -> None:
    before = signal.getsignal(number)
    ports: list[int] = []

    def ready(port: int) -> None:
        ports.append(port)
        threading.Timer(0.2, signal.raise_signal, [number]).start()

    run_server(Endpoint(service), "127.0.0.1", 0, ready=ready)

    assert ports[0] > 0
    assert signal.getsignal(number) is before


@pytest.mark.parametrize(("keys", "warned"), [(None, True), ({"a": AccessKey("a", "b")}, False)])
def test_strangers_reach_it_only_with_a_warning(
    keys: dict[str, AccessKey] | None, warned: bool, service: Service, caplog: pytest.LogCaptureFixture
) -> None:
    def ready(port: int) -> None:
        threading.Timer(0.1, signal.raise_signal, [signal.SIGTERM]).start()

    run_server(Endpoint(service, access_keys=keys), "0.0.0.0", 0, ready=ready)

    assert ("can be reached from other machines" in caplog.text) == warned


def test_requests_are_logged_when_somebody_asks(client: Any, tmp_path: Path) -> None:
    path = tmp_path / "access.log"
    handler = write_access_log(path)
    try:
        served = client.call("ListWorlds")
        refused = client.send("POST", b"/a\r\nb\x80", b"")
    finally:
        LOGGER.removeHandler(handler)
        LOGGER.setLevel(logging.NOTSET)
        handler.close()
    client.call("ListFleets")

    first, second = path.read_text().splitlines()
    assert " 127.0.0.1 POST /listWorlds 200 - " in first
    assert first.endswith(served.headers["x-amzn-requestid"])
    assert r"POST /a\r\nb\x80 404 UnknownOperationException" in second
    assert second.endswith(refused.headers["x-amzn-requestid"])
