"""Fast uploads of objects and parts: signed requests without boto3's client, which takes three times as long for each.

A request here has the same CRC32, and uses the client's own connections, so that its proxies, certificates and timeouts
count. If the answer is anything but success, the caller uses the client, which retries, finds regions and explains
errors.
"""

import hashlib
import hmac
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast
from urllib.parse import quote, urlsplit

import boto3
from botocore.awsrequest import AWSPreparedRequest
from botocore.exceptions import BotoCoreError

if TYPE_CHECKING:
    from types_boto3_s3 import S3Client

_STORED = 200
_USUAL_PORTS = {"http": 80, "https": 443}
_ALGORITHM = "AWS4-HMAC-SHA256"
_PIECE_BYTES = 256 << 10
"""Size in bytes of the pieces in which data are sent.

Between two pieces the transfer may be stopped; on a slow connection a piece takes seconds.
"""


class Stored(NamedTuple):
    """ETag and checksum that the server reports for a stored object."""

    etag: str
    crc32: str | None
    """CRC-32 in base64; `None`: the server does not report it."""


class _Answer(Protocol):
    """Members of a response of botocore's HTTP session that are used here."""

    @property
    def status_code(self) -> int: ...

    @property
    def headers(self) -> dict[str, str]: ...


class Credentials(Protocol):
    """Interface of AWS credentials at one moment."""

    @property
    def access_key(self) -> str:
        """Access key id."""
        ...

    @property
    def secret_key(self) -> str:
        """Secret access key, which signs requests."""
        ...

    @property
    def token(self) -> str | None:
        """Session token of temporary credentials; `None` for permanent ones."""
        ...


class QuickPuts:
    """Fast uploads to an S3 endpoint with path-style buckets: signs requests without botocore.

    Args:
        client: Boto3 client whose connections are used.
        endpoint_url: The endpoint.
        region: The region to sign for.
        session: Boto3 session with the credentials.
    """

    def __init__(self, client: "S3Client", endpoint_url: str, region: str, session: boto3.Session) -> None:
        parts = urlsplit(endpoint_url)
        is_usual = parts.port in (None, _USUAL_PORTS.get(parts.scheme))
        self._host = parts.netloc.rpartition(":")[0] if parts.port and is_usual else parts.netloc
        self._endpoint_url = endpoint_url.rstrip("/")
        self._region = region
        self._session = session
        self._user_agent: str = cast("Any", client.meta.config).user_agent
        # There is no public way to a client's connections; where a release has them elsewhere, the client stores all.
        self._http: Any = getattr(getattr(client, "_endpoint", None), "http_session", None)

    def put(
        self,
        bucket: str,
        key: str,
        data: bytes,
        crc32: str,
        *,
        query: str = "",
        stopped: Callable[[], bool] | None = None,
    ) -> Stored | None:
        """Uploads an object or part with one request; `None` if that did not work.

        Args:
            bucket: The bucket.
            key: The object's key.
            data: Content of the object or part.
            crc32: CRC32 of the data, in base64; the server compares it.
            query: Names the part, quoted, with its members in order; none for an object.
            stopped: Called between two pieces; true stops the transfer.

        Returns:
            ETag and checksum of the stored object; `None`: it may not be stored; boto3's client will find out why.

        Raises:
            StorageError: The credentials of a role could not be had again.
            CancelledError: `stopped` said so.
        """
        try:
            credentials = self._session.get_credentials()
            if credentials is None or self._http is None:
                return None
            path = f"/{bucket}/{quote(key, safe='/~')}"
            keys = cast("Credentials", credentials.get_frozen_credentials())
            headers: Any = self.signed(path, data, crc32, keys, datetime.now(UTC), query)
            url = f"{self._endpoint_url}{path}" + (f"?{query}" if query else "")
            body: Any = data if stopped is None else _pieces(data, stopped)
            answer = cast(
                "_Answer", self._http.send(AWSPreparedRequest("PUT", url, headers, body, stream_output=False))
            )
        except BotoCoreError:
            return None
        if answer.status_code != _STORED:
            return None
        return Stored(answer.headers["ETag"].strip('"'), answer.headers.get("x-amz-checksum-crc32"))

    def signed(
        self, path: str, data: bytes, crc32: str, credentials: Credentials, now: datetime, query: str = ""
    ) -> dict[str, str]:
        """Returns the headers of a PUT request, signed with AWS Signature Version 4.

        Args:
            path: Path of the URL, quoted.
            data: The body.
            crc32: CRC32 of the body, in base64.
            credentials: Credentials that sign the request.
            now: The time, in UTC.
            query: Query string of the URL, quoted and in order.
        """
        day, time = f"{now:%Y%m%d}", f"{now:%Y%m%dT%H%M%SZ}"
        digest = hashlib.sha256(data).hexdigest()
        headers = {  # in the order in which they are signed
            "host": self._host,
            "x-amz-checksum-crc32": crc32,
            "x-amz-content-sha256": digest,
            "x-amz-date": time,
        }
        if credentials.token:
            headers["x-amz-security-token"] = credentials.token
        names = ";".join(headers)
        request = "\n".join(["PUT", path, query, *(f"{name}:{headers[name]}" for name in headers), "", names, digest])
        scope = (day, self._region, "s3", "aws4_request")
        place = "/".join(scope)
        secret = f"AWS4{credentials.secret_key}".encode()
        for part in (*scope, f"{_ALGORITHM}\n{time}\n{place}\n{hashlib.sha256(request.encode()).hexdigest()}"):
            secret = hmac.digest(secret, part.encode(), "sha256")
        by = f"Credential={credentials.access_key}/{place}, SignedHeaders={names}, Signature={secret.hex()}"
        return {
            **headers,
            "Authorization": f"{_ALGORITHM} {by}",
            "Content-Length": str(len(data)),
            "User-Agent": self._user_agent,
        }


def _pieces(data: bytes, stopped: Callable[[], bool]) -> Iterator[memoryview]:
    view = memoryview(data)
    for start in range(0, len(view), _PIECE_BYTES):
        if stopped():
            raise CancelledError
        yield view[start : start + _PIECE_BYTES]
