"""Opens the object store that is named in the settings."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from ...schemas.settings import Settings
from ...schemas.wire.errors import ConfigurationError
from .directory import DirectoryStore
from .object_store import ObjectStore

if TYPE_CHECKING:
    from boto3 import Session


def open_store(settings: Settings, environ: Mapping[str, str]) -> ObjectStore:
    """Opens the object store that the settings name (folder, S3 server or AWS), without accessing it.

    A folder becomes a `DirectoryStore`, `http://…` or `https://…` an `S3Store` on that endpoint, and
    `aws` an `S3Store` on AWS. Credentials are looked for as every AWS tool does: `AWS_ACCESS_KEY_ID`
    and `AWS_SECRET_ACCESS_KEY` (and `AWS_SESSION_TOKEN`), `AWS_PROFILE`, the shared configuration
    files, the machine's role.

    Args:
        settings: `object_store` and `region` are used.
        environ: Environment variables, usually `os.environ`.

    Raises:
        ConfigurationError: The settings or the credentials cannot be used.
    """
    place = settings.object_store
    if place == "aws" or "://" in place:
        return _s3(s3_endpoint(settings), settings.region, environ)
    return DirectoryStore(Path(place).expanduser())


def s3_endpoint(settings: Settings) -> str | None:
    """Returns the URL of the S3 server in the settings; `None` for AWS or a folder.

    Raises:
        ConfigurationError: The URL cannot be used.
    """
    return _endpoint(settings.object_store) if "://" in settings.object_store else None


def _endpoint(url: str) -> str:
    """Returns the URL of an S3 server without a slash at its end, after checking it.

    Raises `ConfigurationError` if it holds a user name or password, which the message does not repeat, or is no HTTP
    address without path and query.
    """
    parts = urlsplit(url)
    if parts.username or parts.password:
        raise ConfigurationError(
            "ROBOMAKER_OBJECT_STORE holds credentials; put them into AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
        )
    try:
        usable = parts.scheme in ("http", "https") and bool(parts.hostname) and (parts.port or 1) > 0
    except ValueError:  # the port is no number
        usable = False
    if not usable or parts.query or parts.fragment or parts.path not in ("", "/"):
        raise ConfigurationError(
            f"ROBOMAKER_OBJECT_STORE is {url!r}; it has to be a folder, an S3 endpoint such as "
            "http://127.0.0.1:8333 without path or query, or aws"
        )
    return url.rstrip("/")


def _s3(endpoint_url: str | None, region: str, environ: Mapping[str, str]) -> ObjectStore:
    from botocore.exceptions import BotoCoreError  # only who uses S3 waits for its import

    from .s3 import S3Store

    try:
        return S3Store(endpoint_url, region, own_session(environ))
    except (BotoCoreError, ValueError) as error:
        raise ConfigurationError(f"the object store {endpoint_url or 'aws'} cannot be used: {error}") from error


def own_session(environ: Mapping[str, str]) -> "Session":
    """Opens a boto3 session with the credentials in environment variables, or AWS tools' defaults.

    Raises:
        ConfigurationError: Only one half of an access key is set.
    """
    from .aws_sessions import new_session

    key, secret = environ.get("AWS_ACCESS_KEY_ID"), environ.get("AWS_SECRET_ACCESS_KEY")
    if bool(key) != bool(secret):
        given, missing = ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY")[:: 1 if key else -1]
        raise ConfigurationError(f"{given} is set but {missing} is not")
    return new_session(
        key or None,
        secret or None,
        environ.get("AWS_SESSION_TOKEN") or None if key else None,
        environ.get("AWS_PROFILE") or None,
    )
