"""Verifies request signatures (AWS Signature Version 4) with the AWS SDK's own code; each is accepted once."""

import hashlib
import hmac
import re
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from email.utils import parsedate_to_datetime
from typing import Any

from botocore.auth import SigV4Auth
from botocore.awsrequest import AWSRequest
from botocore.compat import HTTPHeaders
from botocore.credentials import Credentials

from ....schemas.wire.errors import ThrottlingException
from ..protocol_errors import (
    IncompleteSignatureException,
    InvalidSignatureException,
    MissingAuthenticationTokenException,
    UnrecognizedClientException,
)
from ..service_requests import ServiceRequest
from .access_keys import AccessKey

GRACE_S = 2.0
"""Time in which a client may send the same signature again, in seconds: SDKs sign a retry in the same second alike."""

_REPEATABLE = ("Describe", "List", "Get", "Batch", "Cancel", "Delete", "Update", "Tag", "Untag", "Register", "Deregist")


def is_repeatable(operation: str, members: Mapping[str, Any]) -> bool:
    """Whether a repeated API call has no further effect (read-only, or with a client token)."""
    return operation.startswith(_REPEATABLE) or bool(members.get("clientRequestToken"))


class Replays:
    """Remembers accepted signatures while they are valid, against replayed requests.

    Args:
        valid: Time for which a signature is valid after it was made.
    """

    def __init__(self, valid: timedelta) -> None:
        self._valid_s = valid.total_seconds()
        self._minutes: dict[int, dict[bytes, float]] = {}  # by the minute in which they cease to be valid
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return sum(map(len, self._minutes.values()))

    def check(self, signature: str, signed_at: datetime, now: datetime, *, repeatable: bool) -> None:
        """Records a verified signature as used; raises an error if it was used before.

        Args:
            signature: Hexadecimal digits of the signature.
            signed_at: Time of signing.
            now: The time.
            repeatable: Whether a second call would do nothing more.

        Raises:
            InvalidSignatureException: The signature was used before.
            ThrottlingException: The signature was used a moment ago; a client that repeats a call on purpose signs it
                anew at its next try.
        """
        now_s = now.timestamp()
        minute = int((signed_at.timestamp() + self._valid_s) // 60)
        with self._lock:
            for past in [each for each in self._minutes if (each + 1) * 60 < now_s]:
                del self._minutes[past]
            used = self._minutes.setdefault(minute, {})
            key = bytes.fromhex(signature)[:16]
            if (first_s := used.get(key)) is None:
                used[key] = now_s
                return
        if repeatable and now_s - first_s <= GRACE_S:
            return
        if now_s - first_s <= GRACE_S:
            raise ThrottlingException("a request with this signature was served a moment ago; sign again in a second")
        raise InvalidSignatureException("a request with this signature was served already; sign each request anew")


SERVICE = "robomaker"
MAX_CLOCK_SKEW = timedelta(minutes=5)
_ALGORITHM = "AWS4-HMAC-SHA256"
_TIME = "%Y%m%dT%H%M%SZ"
_SIGNATURE = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Signature:
    """Parts of a signed request's `Authorization` header (AWS Signature Version 4)."""

    access_key: str
    date: str
    region: str
    service: str
    signed_headers: tuple[str, ...]
    value: str


@dataclass(frozen=True)
class Signer:
    """Access key, signature and time of a signed request."""

    key: AccessKey
    signature: str
    signed_at: datetime


class Authenticator:
    """Verifies the signatures of API requests."""

    def __init__(self, access_keys: Mapping[str, AccessKey], region: str, clock: Callable[[], datetime]) -> None:
        self._access_keys = access_keys
        self._region = region
        self._clock = clock
        self._replays = Replays(MAX_CLOCK_SKEW)

    def use(self, signer: Signer, *, repeatable: bool) -> None:
        """Records a request's signature as used; raises an error if it was used before."""
        self._replays.check(signer.signature, signer.signed_at, self._clock(), repeatable=repeatable)

    def check(self, request: ServiceRequest) -> Signer:
        """Verifies a request's signature, and returns its signer.

        Raises:
            ProtocolError: The signature is not of a known key; with the reason in AWS's terms.
        """
        signature = _parsed(request)
        key = self._access_keys.get(signature.access_key)
        if key is None:
            raise UnrecognizedClientException(f"there is no access key {signature.access_key[:128]!r}")
        self._check_scope(signature)
        signed_at = self._check_time(request, signature)
        _check_coverage(request, signature)
        _check_payload(request)
        if not hmac.compare_digest(_expected(request, signature, key.secret, signed_at), signature.value):
            raise InvalidSignatureException(
                "the signature is not the one this request has with this access key; check the secret access key"
            )
        return Signer(key, signature.value, signed_at)

    def _check_scope(self, signature: Signature) -> None:
        for what, given, wanted in (
            ("service", signature.service, SERVICE),
            ("region", signature.region, self._region),
        ):
            if given != wanted:
                raise InvalidSignatureException(f"the request is signed for {what} {given[:64]!r}; sign for {wanted!r}")

    def _check_time(self, request: ServiceRequest, signature: Signature) -> datetime:
        signed_at = _signed_at(request)
        if signed_at.strftime("%Y%m%d") != signature.date:
            raise InvalidSignatureException(f"the credential is of {signature.date}, the request of {signed_at:%Y%m%d}")
        now = self._clock()
        if abs(now - signed_at) > MAX_CLOCK_SKEW:
            raise InvalidSignatureException(
                f"the request was signed at {signed_at:{_TIME}}, here it is {now:{_TIME}}; "
                f"{MAX_CLOCK_SKEW.seconds // 60} minutes apart is the most; check both clocks"
            )
        return signed_at


def _parsed(request: ServiceRequest) -> Signature:
    headers = request.headers.getlist("authorization")
    if not headers:
        raise MissingAuthenticationTokenException("the request is not signed; sign it with Signature Version 4")
    algorithm, _, rest = headers[0].partition(" ")
    if len(headers) > 1 or algorithm != _ALGORITHM:
        raise IncompleteSignatureException(f"Authorization has to be one header that begins with {_ALGORITHM}")
    pairs = (part.strip().partition("=") for part in rest.split(","))
    parts = {name: value for name, _, value in pairs}
    if missing := [name for name in ("Credential", "SignedHeaders", "Signature") if not parts.get(name)]:
        raise IncompleteSignatureException(f"Authorization lacks {' and '.join(missing)}")
    credential = parts["Credential"].rsplit("/", 4)
    if len(credential) != 5 or credential[4] != "aws4_request" or not all(credential):
        raise IncompleteSignatureException(
            "Credential in Authorization has to be <access key>/<date>/<region>/<service>/aws4_request"
        )
    if not _SIGNATURE.fullmatch(parts["Signature"]):
        raise IncompleteSignatureException("Signature in Authorization has to be 64 hexadecimal digits")
    access_key, date, region, service, _ = credential
    return Signature(access_key, date, region, service, tuple(parts["SignedHeaders"].split(";")), parts["Signature"])


def _signed_at(request: ServiceRequest) -> datetime:
    """Returns the time at which a request was signed, from its header `X-Amz-Date` or else `Date`.

    Raises IncompleteSignatureException if it has neither, or one of another form.
    """
    amazon, plain = request.headers.get("x-amz-date"), request.headers.get("date")
    try:
        if amazon is not None:
            return datetime.strptime(amazon, _TIME).replace(tzinfo=UTC)
        if plain is not None:
            return parsedate_to_datetime(plain).astimezone(UTC)
    except (ValueError, OverflowError):
        given = str(amazon or plain)[:64]
        raise IncompleteSignatureException(f"the date is {given!r}; X-Amz-Date has the form {_TIME}") from None
    raise IncompleteSignatureException("X-Amz-Date is missing")


def _check_coverage(request: ServiceRequest, signature: Signature) -> None:
    """Checks that the signature covers all relevant headers.

    Raises InvalidSignatureException, which names the headers, if one is not signed or is missing.
    """
    present = set(request.headers.keys())
    needed = {"host"} | {name for name in present if name.startswith("x-amz-")}
    needed |= {"date"} if "x-amz-date" not in present else set()
    if unsigned := sorted(needed - set(signature.signed_headers)):
        raise InvalidSignatureException(f"SignedHeaders in Authorization lacks {', '.join(unsigned)[:200]}")
    if absent := sorted(set(signature.signed_headers) - present):
        raise InvalidSignatureException(f"the signature is for headers that are not there: {', '.join(absent)[:200]}")


def _check_payload(request: ServiceRequest) -> None:
    given = request.headers.get("x-amz-content-sha256")
    if given is not None and given != hashlib.sha256(request.content).hexdigest():
        raise InvalidSignatureException("X-Amz-Content-SHA256 is not the hash of the body that arrived")


class _Verifier(SigV4Auth):
    """Computes the SigV4 signature over the headers that the client declares as signed."""

    def __init__(self, credentials: Credentials, region: str, signed_headers: tuple[str, ...]) -> None:
        super().__init__(credentials, SERVICE, region)
        self._signed = frozenset(signed_headers)

    def headers_to_sign(self, request: AWSRequest) -> HTTPHeaders:
        """Returns the headers that the client has signed."""
        chosen = HTTPHeaders()
        for name, value in request.headers.items():
            if name.lower() in self._signed:
                chosen[name.lower()] = value
        return chosen


def _expected(request: ServiceRequest, signature: Signature, secret: str, signed_at: datetime) -> str:
    url = f"http://host{request.raw_path}" + (f"?{request.raw_query}" if request.raw_query else "")
    headers = HTTPHeaders()
    for name, value in request.headers.items():
        headers[name] = value
    signed = AWSRequest(method=request.method, url=url, data=request.content)
    signed.headers = headers
    signed.context["timestamp"] = signed_at.strftime(_TIME)
    verifier = _Verifier(Credentials(signature.access_key, secret), signature.region, signature.signed_headers)
    canonical = verifier.canonical_request(signed)
    return str(verifier.signature(verifier.string_to_sign(signed, canonical), signed))
