"""Sets up access roles on an S3 server: buckets, users with policies, and their keys in the roles file."""

import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from secrets import token_urlsafe
from typing import Any, Protocol, TypeVar
from urllib.parse import urlsplit

from ....schemas.extras import how_to_install
from ....schemas.roles import Role
from ....schemas.settings import Settings
from ....schemas.wire.errors import ConfigurationError, StorageAccessDeniedError, StorageError, StorageUnavailableError
from ...files.whole_files import write_whole
from ..configured_store import own_session, s3_endpoint
from ..object_store import ObjectStore
from .roles_file import buckets_of, parse_roles, policy_of, read_roles_file

SERVER = "MinIO"
"""Beginning of the header `Server` in MinIO's responses."""

_KEY_BYTES = 30
_Answer = TypeVar("_Answer")


class MinioUsers:
    """Creates users and policies on a MinIO server.

    Args:
        endpoint: The server.
        environ: Environment variables, which name the credentials of who may make users.

    Raises:
        ConfigurationError: The package `minio` is missing, or there are no credentials.
    """

    def __init__(self, endpoint: str, environ: Mapping[str, str]) -> None:
        try:
            from minio import MinioAdmin
            from minio.credentials.providers import StaticProvider
        except ImportError as error:
            raise ConfigurationError(
                f"{endpoint} is a MinIO server, whose users are made with the package minio, which is not installed: "
                f"{how_to_install('minio')}"
            ) from error
        found = own_session(environ).get_credentials()
        if found is None:
            raise ConfigurationError(f"there are no credentials for {endpoint}; set AWS_ACCESS_KEY_ID and its secret")
        keys, parts = found.get_frozen_credentials(), urlsplit(endpoint)
        self._endpoint = endpoint
        self._admin = MinioAdmin(
            endpoint=parts.netloc,
            credentials=StaticProvider(str(keys.access_key), str(keys.secret_key), keys.token),
            secure=parts.scheme == "https",
        )

    def has(self, name: str) -> bool:
        """Whether a user exists on the MinIO server."""
        return self._ask("look for a user", lambda: self._admin.user_info(name), missing="404") is not None

    def ensure(self, name: str, policy: str) -> None:
        """Creates or changes the policy of a user of the MinIO server; `new_key` creates the user itself."""
        admin: Any = self._admin  # its own types of policies are not complete
        self._ask("make a policy", lambda: admin.policy_add(name, policy=json.loads(policy)))

    def new_key(self, name: str) -> tuple[str, str]:
        """Creates a user of the MinIO server with its policy, or gives it a new key; returns key id and secret."""
        key = token_urlsafe(_KEY_BYTES)
        self._ask("make a user", lambda: self._admin.user_add(name, key))
        self._ask("set the policy of a user", lambda: self._admin.policy_set(name, user=name))
        return name, key

    def _ask(self, doing: str, call: Callable[[], _Answer], missing: str = "") -> _Answer | None:
        from minio.error import MinioAdminException
        from urllib3.exceptions import HTTPError

        try:
            return call()
        except MinioAdminException as error:
            code = str(vars(error).get("_code"))  # no public name says it
            if code == missing:
                return None
            kind = StorageAccessDeniedError if code == "403" else StorageError
            raise kind(f"cannot {doing} at {self._endpoint}: {error}") from error
        except HTTPError as error:
            raise StorageUnavailableError(f"cannot {doing} at {self._endpoint}: {error}") from error


_POLICY = "robomaker-role"
_READ_ONLY = "IAM write operations are disabled"
"""Part of the error message of a SeaweedFS server that was started without write access to users."""

_HEADER = re.compile(r"^[ \t]*\[\[[ \t]*role[ \t]*\]\][ \t]*(#.*)?$", re.MULTILINE)


def initialise(
    settings: Settings, store: ObjectStore, environ: Mapping[str, str], *, dry_run: bool = False
) -> Iterator[str]:
    """Creates the buckets of all roles, and their users on the S3 server; yields what was done.

    Made again, it changes what policies say and nothing else. Roles whose credentials come from a profile, a block or
    STS are left to those who made these.

    Args:
        settings: The roles file, and the store.
        store: This process's own, whose credentials may make buckets and users.
        environ: Environment variables, which name these credentials.
        dry_run: Whether nothing is changed, and steps are only told.

    Raises:
        ConfigurationError: The roles file does not exist, or is invalid.
        StorageError: The server refuses something, or has no interface for users.
    """
    path = settings.roles_file
    if path is None:
        raise ConfigurationError("ROBOMAKER_ROLES_FILE is not set; it has to name the file of the roles to make")
    roles = read_roles_file(path)
    for bucket in sorted({bucket for role in roles for bucket in buckets_of(role)}):
        if not dry_run:
            store.ensure_bucket(bucket)
        yield f"bucket {bucket}"
    if settings.object_store == "aws":
        raise ConfigurationError(
            "on AWS roles are made in IAM; give those of the roles file assume_role: `storage init` has no more to do"
        )
    if (endpoint := s3_endpoint(settings)) is None:
        return
    users = _users_of(endpoint, settings.region, environ)
    for index, role in enumerate(roles):
        if role.profile or role.block or role.assume_role or not buckets_of(role):
            continue
        yield from _user(users, path, index, role, dry_run=dry_run)


def _user(users: "_Users", path: Path, index: int, role: Role, *, dry_run: bool) -> Iterator[str]:
    name = user_name(role.arn)
    if role.access_key_id and not users.has(name):
        return  # keys that somebody has put into the file by hand
    yield f"user {name} with the policy of {role.arn}"
    if not dry_run:
        users.ensure(name, policy_of(role))
    if not role.access_key_id:
        yield f"access key of {name}, in {path}"
        if not dry_run:
            write_keys(path, index, *users.new_key(name))


def user_name(arn: str) -> str:
    """Returns the name of a role's user on the S3 server."""
    words = re.sub(r"[^A-Za-z0-9]+", "-", arn.partition(":role/")[2]).strip("-")[:40]
    return f"robomaker-{words}-{hashlib.sha256(arn.encode()).hexdigest()[:8]}"


def write_keys(path: Path, index: int, access_key_id: str, secret_access_key: str) -> None:
    """Adds an access key to a role in the roles file, preserving everything else.

    Args:
        path: The file.
        index: Number of the role in the file, from 0.
        access_key_id: The key's id.
        secret_access_key: The key.

    Raises:
        ConfigurationError: The file is written in a way that nothing can be added to safely.
    """
    text = path.read_text(encoding="utf-8")
    before = parse_roles(text, str(path))
    headers = list(_HEADER.finditer(text))
    keys = {"access_key_id": access_key_id, "secret_access_key": secret_access_key}
    wanted = [role.model_copy(update=keys) if place == index else role for place, role in enumerate(before)]
    lines = "".join(f'\n{name} = "{value}"' for name, value in keys.items())
    after = text[: headers[index].end()] + lines + text[headers[index].end() :] if len(headers) == len(before) else ""
    if not after or list(parse_roles(after, str(path))) != wanted:
        raise ConfigurationError(f"roles file '{path}': keys can be added to roles below a line [[role]] each")
    write_whole(path, after, 0o600, is_synced=True)


class _Users(Protocol):
    """Interface for the users of an S3 server."""

    def has(self, name: str) -> bool:
        """Whether a user exists on the S3 server."""
        ...

    def ensure(self, name: str, policy: str) -> None:
        """Sets the policy of a user on the S3 server."""
        ...

    def new_key(self, name: str) -> tuple[str, str]:
        """Creates an access key for a user of the S3 server; returns its id and secret."""
        ...


def _users_of(endpoint: str, region: str, environ: Mapping[str, str]) -> _Users:
    """Returns the client for a server's users, depending on the interface that the server has.

    Raises:
        StorageError: The server does not answer.
        ConfigurationError: It is a MinIO server, and the package `minio` or the credentials for it are missing.
    """
    if not _server_name(endpoint, region, environ).startswith(SERVER):
        return IamUsers(endpoint, region, environ)
    return MinioUsers(endpoint, environ)


def _server_name(endpoint: str, region: str, environ: Mapping[str, str]) -> str:
    """Returns the name that an S3 server gives itself in the header `Server`, also if it refuses the request.

    The name is empty if the answer has no such header. Raises `StorageError` if the server does not answer.
    """
    from botocore.exceptions import BotoCoreError, ClientError

    from ..s3.failures import from_client_error

    session: Any = own_session(environ)
    try:
        answer: Any = session.client("s3", region_name=region, endpoint_url=endpoint).list_buckets()
    except ClientError as error:
        answer = error.response
    except BotoCoreError as error:
        raise from_client_error(error, f"cannot ask {endpoint}") from error
    return str(answer["ResponseMetadata"].get("HTTPHeaders", {}).get("server", ""))


class IamUsers:
    """Users of an S3 server that has the interface of AWS IAM, as SeaweedFS has."""

    def __init__(self, endpoint: str, region: str, environ: Mapping[str, str]) -> None:
        session: Any = own_session(environ)
        self._endpoint = endpoint
        self._iam: Any = session.client("iam", region_name=region, endpoint_url=endpoint)

    def has(self, name: str) -> bool:
        """Whether a user exists on the server, by its IAM interface."""
        return self.ask("look for a user", lambda: self._iam.get_user(UserName=name), "NoSuchEntity") is not None

    def ensure(self, name: str, policy: str) -> None:
        """Creates a user by the IAM interface unless it exists, and sets its policy."""
        self.ask("make a user", lambda: self._iam.create_user(UserName=name), "EntityAlreadyExists")
        request = {"UserName": name, "PolicyName": _POLICY, "PolicyDocument": policy}
        self.ask("set the policy of a user", lambda: self._iam.put_user_policy(**request))

    def new_key(self, name: str) -> tuple[str, str]:
        """Creates an access key of a user by the IAM interface; returns its id and secret."""
        made = self.ask("make an access key", lambda: self._iam.create_access_key(UserName=name))["AccessKey"]
        return made["AccessKeyId"], made["SecretAccessKey"]

    def ask(self, doing: str, call: Any, expected: str = "") -> Any:
        """Calls the IAM interface of the S3 server, and returns its answer.

        Args:
            doing: Description of the action, for errors.
            call: The call.
            expected: Error code that is not treated as an error.

        Returns:
            The answer; `None` for the expected error.

        Raises:
            StorageError: The server refuses, or does not answer.
        """
        from botocore.exceptions import BotoCoreError, ClientError

        from ..s3.failures import from_client_error

        try:
            return call()
        except ClientError as error:
            if error.response.get("Error", {}).get("Code") == expected:
                return None
            raise self._refused(error, doing) from error
        except BotoCoreError as error:
            raise from_client_error(error, f"cannot {doing} at {self._endpoint}") from error

    def _refused(self, error: Any, doing: str) -> StorageError:
        from ..s3.failures import from_client_error

        why = from_client_error(error, f"cannot {doing} at {self._endpoint}")
        advice = "users are made through the interface of AWS IAM, for which the server and these keys have to be made"
        if _READ_ONLY in str(why):
            advice = "start SeaweedFS with -s3.iam.readOnly=false, so that it makes users"
        return type(why)(f"{why}; {advice}")
