"""boto3 sessions with the credentials of a role, which are renewed before they expire."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, cast

from boto3 import Session
from botocore.credentials import RefreshableCredentials
from botocore.exceptions import BotoCoreError, ClientError
from botocore.session import get_session

from ....schemas.roles import ITSELF, Role
from ....schemas.wire.errors import CredentialsRefusedError, StorageUnavailableError
from ..aws_sessions import new_session
from ..configured_store import own_session
from ..s3.failures import from_client_error
from .roles_file import Keys, ReadBlock, policy_of

_SESSION_NAME = "robomaker"


class _Sts(Protocol):
    """Methods of the STS client that are used here, as its type stubs are not installed."""

    def assume_role(self, **request: Any) -> Mapping[str, Any]: ...


class _Clients(Protocol):
    """Methods of a boto3 session that are used here, as the type stubs of STS are not installed."""

    def client(self, service_name: str, *, region_name: str, endpoint_url: str | None) -> Any: ...


@dataclass(frozen=True)
class SessionSource:
    """Opens boto3 sessions with the credentials of access roles.

    Args:
        endpoint_url: The S3 server, which answers for STS, too; `None`: AWS.
        region: The region to sign for.
        environ: Environment variables, which name this process's own credentials.
        read_block: Reads blocks of Prefect.
    """

    endpoint_url: str | None
    region: str
    environ: Mapping[str, str]
    read_block: ReadBlock

    def session_of(self, role: Role, arn: str) -> Session:
        """Opens a session with a role's credentials; those of an assumed role are renewed.

        Args:
            role: The role.
            arn: The ARN that the request has.

        Raises:
            CredentialsRefusedError: The role gives no credentials.
            StorageUnavailableError: STS does not answer.
        """
        session = self._source(role, arn)
        if role.assume_role is None:
            return session
        sts = cast("_Clients", session).client("sts", region_name=self.region, endpoint_url=self.endpoint_url)

        def assume() -> dict[str, Any]:
            return self._assumed(sts, role, arn)

        credentials = RefreshableCredentials.create_from_metadata(
            metadata=assume(),
            refresh_using=assume,
            method="robomaker-role",
            advisory_timeout=role.duration_s // 2,
            mandatory_timeout=role.duration_s // 4,
        )
        return _session_with(credentials)

    def _source(self, role: Role, arn: str) -> Session:
        """Opens a session with the credentials that a role names, or with those that can assume the role.

        Raises `CredentialsRefusedError` if the role names no credentials, or its profile is unknown or has none.
        """
        if role.access_key_id:
            return new_session(role.access_key_id, role.secret_access_key, role.session_token)
        try:
            if role.profile:
                session = new_session(profile_name=role.profile)
                if session.get_credentials() is None:
                    raise CredentialsRefusedError(f"role {arn}: profile {role.profile!r} has no credentials")
                return session
        except BotoCoreError as error:
            raise CredentialsRefusedError(f"role {arn}: {error}") from error
        if role.block:
            return self._of_block(role.block, arn)
        if role.assume_role:
            return own_session(self.environ)
        raise CredentialsRefusedError(
            f"role {arn} has no credentials in the roles file; `robomaker storage init` makes some, or give it "
            "access_key_id and secret_access_key, profile, block or assume_role"
        )

    def _of_block(self, block: str, arn: str) -> Session:
        slug, _, name = block.partition("/")
        content = self.read_block(slug, name)
        if content is None:
            raise CredentialsRefusedError(f"role {arn}: the Prefect server has no block {block}")
        key, secret = ("minio_root_user", "minio_root_password") if slug == "minio-credentials" else _KEY_MEMBERS
        if content.get(key) and content.get(secret):
            return new_session(content[key], content[secret], content.get("aws_session_token") or None)
        if content.get("profile_name"):
            return new_session(profile_name=content["profile_name"])
        raise CredentialsRefusedError(f"role {arn}: block {block} has neither {key} and {secret} nor profile_name")

    def _assumed(self, sts: _Sts, role: Role, arn: str) -> dict[str, Any]:
        """Requests temporary credentials from STS, as metadata for botocore's refreshable credentials.

        A policy restricts them to the keys that the role names; a role that names none gets no policy, and so all that
        the assumed role may do.

        Raises `StorageUnavailableError` if STS does not answer, and `CredentialsRefusedError` if it refuses.
        """
        wanted = arn if role.assume_role == ITSELF else role.assume_role
        request: dict[str, Any] = {
            "RoleArn": wanted,
            "RoleSessionName": _SESSION_NAME,
            "DurationSeconds": role.duration_s,
        }
        if role.read or role.write:
            request["Policy"] = policy_of(role)
        try:
            found = sts.assume_role(**request)["Credentials"]
        except (ClientError, BotoCoreError) as error:
            why = from_client_error(error, f"role {wanted} cannot be assumed at {self.endpoint_url or 'AWS'}")
            raise why if isinstance(why, StorageUnavailableError) else CredentialsRefusedError(str(why)) from error
        return {
            "access_key": found["AccessKeyId"],
            "secret_key": found["SecretAccessKey"],
            "token": found["SessionToken"],
            "expiry_time": found["Expiration"].isoformat(),
        }


_KEY_MEMBERS = ("aws_access_key_id", "aws_secret_access_key")


def keys_of(session: Session) -> Keys:
    """Returns a session's current credentials, renewed if they soon expire.

    Raises:
        CredentialsRefusedError: The session has no credentials.
    """
    try:
        credentials = session.get_credentials()
        frozen = credentials and credentials.get_frozen_credentials()
    except BotoCoreError as error:
        raise CredentialsRefusedError(str(error)) from error
    if credentials is None or frozen is None or not frozen.access_key or not frozen.secret_key:
        raise CredentialsRefusedError("there are no credentials")
    # Every kind that is had again has it, and no public name says it.
    expires_at = vars(credentials).get("_expiry_time")
    return Keys(frozen.access_key, frozen.secret_key, frozen.token or None, expires_at)


def _session_with(credentials: RefreshableCredentials) -> Session:
    inner = get_session()
    vars(inner)["_credentials"] = credentials  # botocore has no public way to give a session such credentials
    return new_session(inner=inner)
