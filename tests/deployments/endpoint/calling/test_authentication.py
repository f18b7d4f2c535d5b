"""Signatures, made with botocore's own signer and then spoilt in every way."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from types import MappingProxyType
from typing import Any
from urllib.parse import quote

import pytest
from botocore.auth import SigV4Auth
from botocore.awsrequest import AWSRequest
from botocore.compat import HTTPHeaders
from botocore.credentials import Credentials
from helpers.asgi import Answer, Client

from prefect_robomaker.deployments.endpoint.application import Endpoint
from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.tasks.service.service import Service

KEY, SECRET = "AKIAEXAMPLE", "secret/with+signs="
ARN = "arn:aws:robomaker:us-east-1:000000000000:robot-application/scout/1543190400000"

Headers = dict[str, str]
Change = Callable[[Headers], object]


def signed(
    method: str = "POST",
    target: str = "/listWorlds",
    body: bytes = b"{}",
    *,
    key: str = KEY,
    secret: str = SECRET,
    region: str = "us-east-1",
    service: str = "robomaker",
    token: str | None = None,
    more: Mapping[str, str] = MappingProxyType({}),
) -> Headers:
    """The headers of a request that botocore signed."""
    headers = {"host": "robots.example.com:8080", "content-type": "application/json", **more}
    request = AWSRequest(method=method, url=f"http://robots.example.com:8080{target}", data=body, headers=headers)
    SigV4Auth(Credentials(key, secret, token), service, region).add_auth(request)
    return {name.lower(): value for name, value in request.headers.items()}


@pytest.fixture
def guarded(service: Service) -> Iterator[Client]:
    """A client of an endpoint that wants signatures."""
    client = Client(Endpoint(service, access_keys={KEY: AccessKey(KEY, SECRET), "OTHER": AccessKey("OTHER", "other")}))
    yield client
    client.close()


def refusal(answer: Answer) -> str:
    assert answer.status == 403
    assert SECRET not in answer.json["message"]
    return answer.error


def test_requests_signed_by_botocore_are_served(guarded: Client) -> None:
    assert guarded.send("POST", "/listWorlds", b"{}", signed()).status == 200
    assert guarded.send("POST", "/listWorlds", b"{}", signed(key="OTHER", secret="other")).status == 200
    assert guarded.send("POST", "/listWorlds", b"{}", signed(token="a session")).status == 200
    assert guarded.send("POST", "/listWorlds", b"{}", signed(more={"x-amz-meta": "a  b "})).status == 200


def test_signatures_hold_for_encoded_paths_and_queries(guarded: Client, template: str) -> None:
    path = f"/tags/{quote(template, safe='')}"
    body = json.dumps({"tags": {"a b": "1", "c:d/e": "2"}}).encode()
    keys = f"{path}?tagKeys=a%20b&tagKeys=c%3Ad%2Fe"

    assert guarded.send("POST", path, body, signed("POST", path, body)).status == 200
    assert guarded.send("GET", path, b"", signed("GET", path, b"")).json == {"tags": {"a b": "1", "c:d/e": "2"}}
    assert guarded.send("DELETE", keys, b"", signed("DELETE", keys, b"")).status == 200
    assert refusal(guarded.send("DELETE", path, b"", signed("DELETE", keys, b""))) == "InvalidSignatureException"


class OtherSigner(SigV4Auth):
    """Signs every header, also those that botocore leaves out."""

    def headers_to_sign(self, request: AWSRequest) -> HTTPHeaders:
        chosen = HTTPHeaders()
        for name, value in request.headers.items():
            chosen[name.lower()] = value
        return chosen


def test_other_sdks_sign_other_headers(guarded: Client) -> None:
    headers = {"host": "h", "content-type": "application/json", "user-agent": "aws-sdk-other/1.0"}
    request = AWSRequest(method="POST", url="http://h/listWorlds", data=b"{}", headers=headers)
    OtherSigner(Credentials(KEY, SECRET), "robomaker", "us-east-1").add_auth(request)
    assert "user-agent" in request.headers["Authorization"]

    assert guarded.send("POST", "/listWorlds", b"{}", dict(request.headers.items())).status == 200


def test_the_date_may_be_in_the_plain_header(guarded: Client) -> None:
    assert (
        guarded.send("POST", "/listWorlds", b"{}", signed(more={"Date": format_datetime(datetime.now(UTC))})).status
        == 200
    )


def test_without_keys_any_signature_will_do(client: Client) -> None:
    headers = {**signed(key="any", secret="thing", region="eu-west-9"), "host": "localhost"}

    assert client.send("POST", "/listWorlds", b"{}", headers).status == 200
    assert client.send("POST", "/listWorlds", b"{}", {"authorization": "AWS4-HMAC-SHA256 nonsense"}).status == 200


def without(name: str) -> Change:
    return lambda headers: headers.pop(name)


def put(**values: str) -> Change:
    return lambda headers: headers.update({name.replace("_", "-"): value for name, value in values.items()})


def edit(old: str, new: str) -> Change:
    def change(headers: Headers) -> None:
        assert old in headers["authorization"]
        headers["authorization"] = headers["authorization"].replace(old, new)

    return change


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (without("authorization"), "MissingAuthenticationTokenException"),
        (put(authorization="Basic YTpi"), "IncompleteSignatureException"),
        (put(authorization="AWS4-HMAC-SHA256"), "IncompleteSignatureException"),
        (put(authorization="AWS4-HMAC-SHA256 Credential=, SignedHeaders=, Signature="), "IncompleteSignatureException"),
        (edit("/aws4_request", ""), "IncompleteSignatureException"),
        (edit("AWS4-HMAC-SHA256", "AWS4-HMAC-SHA1"), "IncompleteSignatureException"),
        (edit("Signature=", "Signature=0"), "IncompleteSignatureException"),
        (edit("Signature=", "Signatures="), "IncompleteSignatureException"),
        (edit(KEY, "AKIANOBODY"), "UnrecognizedClientException"),
        (edit("us-east-1", "us-east-2"), "InvalidSignatureException"),
        (edit("host;", ""), "InvalidSignatureException"),
        (edit(";x-amz-date", ""), "InvalidSignatureException"),
        (edit("host;", "host;not-there;"), "InvalidSignatureException"),
        (put(host="other.example.com"), "InvalidSignatureException"),
        (put(content_type="application/x-amz-json-1.1"), "InvalidSignatureException"),
        (put(x_amz_security_token="added later"), "InvalidSignatureException"),
        (put(x_amz_content_sha256="0" * 64), "InvalidSignatureException"),
        (put(x_amz_content_sha256="UNSIGNED-PAYLOAD"), "InvalidSignatureException"),
        (put(x_amz_date="yesterday"), "IncompleteSignatureException"),
        (put(x_amz_date="20200101T000000Z"), "InvalidSignatureException"),
        (without("x-amz-date"), "IncompleteSignatureException"),
    ],
)
def test_spoilt_requests_are_refused(change: Change, error: str, guarded: Client) -> None:
    headers = signed()
    change(headers)

    assert refusal(guarded.send("POST", "/listWorlds", b"{}", headers)) == error


@pytest.mark.parametrize(
    "options",
    [{"secret": "wrong"}, {"region": "eu-central-1"}, {"service": "s3"}, {"key": "OTHER"}],
    ids=["secret", "region", "service", "key"],
)
def test_signed_for_something_else(options: dict[str, Any], guarded: Client) -> None:
    assert refusal(guarded.send("POST", "/listWorlds", b"{}", signed(**options))) == "InvalidSignatureException"


@pytest.mark.parametrize(
    ("method", "target", "body"),
    [("POST", "/listWorlds", b"{ }"), ("POST", "/listFleets", b"{}"), ("POST", "/listWorlds?a=b", b"{}")],
    ids=["body", "path", "query"],
)
def test_a_signature_is_good_for_its_request_only(method: str, target: str, body: bytes, guarded: Client) -> None:
    assert refusal(guarded.send(method, target, body, signed())) == "InvalidSignatureException"


def test_two_authorizations_are_none(guarded: Client) -> None:
    headers = [(name.encode(), value.encode()) for name, value in signed().items()]
    headers.append((b"authorization", headers[-1][1]))

    assert refusal(guarded.send("POST", "/listWorlds", b"{}", headers)) == "IncompleteSignatureException"


@pytest.mark.parametrize("minutes", [-6, 6])
def test_clocks_that_differ(minutes: int, service: Service) -> None:
    late = replace(service, clock=lambda: datetime.now(UTC) + timedelta(minutes=minutes))
    client = Client(Endpoint(late, access_keys={KEY: AccessKey(KEY, SECRET)}))
    answer = client.send("POST", "/listWorlds", b"{}", signed())
    client.close()

    assert refusal(answer) == "InvalidSignatureException"
    assert "check both clocks" in answer.json["message"]


def test_nothing_is_told_to_strangers_about_operations(guarded: Client) -> None:
    assert refusal(guarded.send("POST", "/makeCoffee", b"{")) == "MissingAuthenticationTokenException"


def test_a_recorded_request_is_not_carried_out_again(service: Service) -> None:
    passed = timedelta()
    later = replace(service, clock=lambda: datetime.now(UTC) + passed)
    client = Client(Endpoint(later, access_keys={KEY: AccessKey(KEY, SECRET)}))
    body = b'{"name": "fleet"}'
    headers = signed("POST", "/createFleet", body)

    assert client.send("POST", "/createFleet", body, headers).status == 200
    assert client.send("POST", "/createFleet", body, headers).error == "ThrottlingException"
    passed = timedelta(minutes=1)
    assert refusal(client.send("POST", "/createFleet", body, headers)) == "InvalidSignatureException"
    client.close()
