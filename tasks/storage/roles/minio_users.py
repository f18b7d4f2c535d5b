"""Users of a MinIO server, which has an interface of its own for administration and none of AWS IAM."""

import json
from collections.abc import Callable, Mapping
from secrets import token_urlsafe
from typing import Any, TypeVar
from urllib.parse import urlsplit

from ....schemas.extras import how_to_install
from ....schemas.wire.errors import (
    ConfigurationError,
    StorageAccessDeniedError,
    StorageError,
    StorageUnavailableError,
)
from ..opening import own_session

SERVER = "MinIO"
"""Beginning of the header `Server` in MinIO's responses."""

_KEY_BYTES = 30
_Answer = TypeVar("_Answer")


class MinioUsers:
    """Users of a MinIO server; the id of a user's access key is its name, and a policy has the name of its user.

    Args:
        endpoint: the server.
        environ: environment variables, which name the credentials of who may make users.

    Raises:
        ConfigurationError: the package `minio` is missing, or there are no credentials.
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
        """Whether there is a user."""
        return self._ask("look for a user", lambda: self._admin.user_info(name), missing="404") is not None

    def ensure(self, name: str, policy: str) -> None:
        """Makes the policy of a user, or changes it; `new_key` makes the user."""
        admin: Any = self._admin  # its own types of policies are not complete
        self._ask("make a policy", lambda: admin.policy_add(name, policy=json.loads(policy)))

    def new_key(self, name: str) -> tuple[str, str]:
        """Makes a user with its policy, or gives it another key; returns the key's id and the key."""
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
