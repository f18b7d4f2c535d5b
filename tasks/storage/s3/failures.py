"""Turns errors of S3 clients into errors of the object store."""

from collections.abc import Generator
from contextlib import contextmanager

from boto3.exceptions import Boto3Error
from botocore.exceptions import (
    BotoCoreError,
    ChecksumError,
    ClientError,
    CredentialRetrievalError,
    FlexibleChecksumError,
    HTTPClientError,
    IncompleteReadError,
    NoAuthTokenError,
    NoCredentialsError,
    PartialCredentialsError,
    ProxyConnectionError,
    SSLError,
    SSOError,
    TokenRetrievalError,
)
from botocore.exceptions import ConnectionError as NoConnectionError
from s3transfer.exceptions import RetriesExceededError, S3DownloadFailedError, S3UploadFailedError, S3ValidationError

from ....schemas.wire.errors import (
    BucketNotFoundError,
    ChecksumMismatchError,
    CredentialsRefusedError,
    ObjectExistsError,
    ObjectNotFoundError,
    StorageAccessDeniedError,
    StorageError,
    StorageFullError,
    StorageUnavailableError,
)
from ...files.untrusted_folders import from_os_error

_BY_CODE: dict[str, type[StorageError]] = {
    "NoSuchBucket": BucketNotFoundError,
    "NoSuchKey": ObjectNotFoundError,
    "404": ObjectNotFoundError,  # a HEAD answer has no body, so its status is all there is
    "NotFound": ObjectNotFoundError,
    # AWS says the first three, STS the fourth; SeaweedFS says of a token that has run out that its key is not known.
    "InvalidAccessKeyId": CredentialsRefusedError,
    "ExpiredToken": CredentialsRefusedError,
    "InvalidToken": CredentialsRefusedError,
    "InvalidClientTokenId": CredentialsRefusedError,
    "SignatureDoesNotMatch": CredentialsRefusedError,
    "PreconditionFailed": ObjectExistsError,
    "412": ObjectExistsError,
    "BadDigest": ChecksumMismatchError,
    "InvalidDigest": ChecksumMismatchError,
    "XAmzContentChecksumMismatch": ChecksumMismatchError,
    "XAmzContentSHA256Mismatch": ChecksumMismatchError,
    "InsufficientStorage": StorageFullError,
    "XMinioStorageFull": StorageFullError,
    "QuotaExceeded": StorageFullError,
    "XMinioAdminBucketQuotaExceeded": StorageFullError,
    # These come with statuses that say otherwise: 400, or that of a throttled call.
    "RequestTimeout": StorageUnavailableError,
    "RequestTimeoutException": StorageUnavailableError,
    "RequestTimeTooSkewed": StorageUnavailableError,  # a clock that is wrong, which is soon put right, and no right
    "SlowDown": StorageUnavailableError,
    "Throttling": StorageUnavailableError,
    "ThrottlingException": StorageUnavailableError,
    "TooManyRequests": StorageUnavailableError,
}
_BY_STATUS: dict[int, type[StorageError]] = {
    401: StorageAccessDeniedError,
    403: StorageAccessDeniedError,
    507: StorageFullError,
}
_LATER = {408, 429, 500, 502, 503, 504}
_CLIENT_ERRORS = (
    ClientError,
    BotoCoreError,
    Boto3Error,
    RetriesExceededError,
    S3DownloadFailedError,
    S3UploadFailedError,
    S3ValidationError,
)
_NO_CREDENTIALS = (
    NoCredentialsError,
    PartialCredentialsError,
    CredentialRetrievalError,
    NoAuthTokenError,
    TokenRetrievalError,
    SSOError,
)
# A name that is not known, a connection that is refused, breaks, or brings nothing in time.
_BROKEN_CONNECTIONS = (HTTPClientError, NoConnectionError, IncompleteReadError)
_NOT_TRUSTED = (SSLError, ProxyConnectionError)
"""boto3's errors of TLS and proxies, which are connection errors too, but need a change of settings."""


@contextmanager
def s3_failures(doing: str, endpoint: str) -> Generator[None]:
    """Converts exceptions of boto3 inside the `with` block to the matching `StorageError`, which is raised.

    Args:
        doing: Description of the action, in words that follow "cannot".
        endpoint: URL of the server; every message names it, as a wrong endpoint has the strangest symptoms.
    """
    try:
        yield
    except _CLIENT_ERRORS as error:
        raise from_client_error(error, f"cannot {doing} at {endpoint}") from error
    except OSError as error:
        raise from_os_error(error, doing) from error


def from_client_error(error: Exception, beginning: str) -> StorageError:
    """Returns, without raising it, the `StorageError` of the right subclass for an error of boto3.

    Args:
        error: Error that boto3 raised.
        beginning: Beginning of the message, such as `cannot read a/b`.
    """
    if isinstance(error, ClientError):
        return _from_answer(error, beginning)
    if isinstance(error, RetriesExceededError):
        return StorageUnavailableError(f"{beginning}: the connection broke again and again: {error.last_exception}")
    if isinstance(error, _NO_CREDENTIALS):
        return CredentialsRefusedError(
            f"{beginning}: {error}; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE"
        )
    if isinstance(error, ChecksumError | FlexibleChecksumError):
        return ChecksumMismatchError(f"{beginning}: {error}")
    if isinstance(error, _NOT_TRUSTED):
        return StorageError(f"{beginning}: {error}")
    if isinstance(error, _BROKEN_CONNECTIONS):
        return StorageUnavailableError(f"{beginning}: {error}")
    return StorageError(f"{beginning}: {error}")


def _from_answer(error: ClientError, beginning: str) -> StorageError:
    code = error.response.get("Error", {}).get("Code", "")
    message = error.response.get("Error", {}).get("Message", "") or "the server gives no reason"
    status = error.response.get("ResponseMetadata", {}).get("HTTPStatusCode", 0)
    other = StorageUnavailableError if status in _LATER else StorageError
    kind = _BY_CODE.get(code) or _BY_STATUS.get(status) or other
    return kind(f"{beginning}: {code}: {message}")
