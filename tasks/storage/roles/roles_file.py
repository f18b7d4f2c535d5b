"""Roles file: reading it, the credentials of a role, and the S3 policy of each role."""

import json
import stat
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ....schemas.roles import Role, RolesFile
from ....schemas.wire.errors import ConfigurationError
from ....schemas.wire.request_problems import nearest


def read_roles_file(path: Path) -> tuple[Role, ...]:
    """Reads the roles file, which may hold secrets and so must be private to its owner.

    Raises:
        ConfigurationError: The file cannot be read, can be read by other users, or is invalid; the message does not
            repeat its values.
    """
    try:
        mode = path.stat().st_mode
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"ROBOMAKER_ROLES_FILE is '{path}': {error.strerror}") from error
    except UnicodeDecodeError:
        raise ConfigurationError(f"ROBOMAKER_ROLES_FILE is '{path}', which is no text in UTF-8") from None
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigurationError(
            f"ROBOMAKER_ROLES_FILE is '{path}', which other users of this machine may use (mode "
            f"{stat.S_IMODE(mode):04o}); `chmod 600` keeps it to yourself"
        )
    return parse_roles(text, str(path))


def parse_roles(text: str, where: str) -> tuple[Role, ...]:
    """Parses the text of a roles file (TOML), and returns its roles.

    Args:
        text: TOML.
        where: The file's name, for messages.

    Raises:
        ConfigurationError: The text is not a valid roles file.
    """
    try:
        content = tomllib.loads(text)
        return RolesFile.model_validate_json(json.dumps(content, default=str)).role
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"roles file '{where}': it is no TOML: {error}") from None
    except ValidationError as error:
        raise ConfigurationError(f"roles file '{where}': {_problem(error)}") from None


def _problem(error: ValidationError) -> str:
    """Describes the first error in the roles file without its value, which may be a secret."""
    first = error.errors(include_url=False, include_input=False)[0]
    path = list(first["loc"])
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).lstrip(".")
    if first["type"] == "extra_forbidden":
        known = tuple(Role.model_fields if len(path) > 1 else RolesFile.model_fields)
        return f"{place} is not known{nearest(str(path[-1]), known)}; known are {', '.join(known)}"
    return f"{place}: {first['msg'].removeprefix('Value error, ')}" if place else first["msg"]


ReadBlock = Callable[[str, str], Mapping[str, Any] | None]
"""Function that returns the content of a Prefect block, with its secrets, by type slug and name.

It returns `None` if the block is missing.
"""


@dataclass(frozen=True)
class Keys:
    """Credentials for the object store: access key id, secret and token."""

    access_key_id: str
    secret_access_key: str = field(repr=False)
    session_token: str | None = field(default=None, repr=False)
    expires_at: datetime | None = None
    """Time at which the credentials expire; `None`: never, or unknown."""


_READ = ("s3:GetObject",)
_WRITE = ("s3:GetObject", "s3:PutObject", "s3:DeleteObject", "s3:AbortMultipartUpload")
_ARN = "arn:aws:s3:::"


def policy_of(role: Role) -> str:
    """Returns the IAM policy (JSON text) that allows a role to read, write and list its own places, nothing else."""
    statements: list[dict[str, Any]] = []
    for places, actions in ((role.read, _READ), (role.write, _WRITE)):
        if places:
            resources = [f"{_ARN}{place}" for place in places]
            statements.append({"Effect": "Allow", "Action": list(actions), "Resource": resources})
    for bucket, prefixes in _listed(role).items():
        statements.append(
            {
                "Effect": "Allow",
                "Action": ["s3:ListBucket"],
                "Resource": [f"{_ARN}{bucket}"],
                "Condition": {"StringLike": {"s3:prefix": prefixes}},
            }
        )
    return json.dumps({"Version": "2012-10-17", "Statement": statements})


def _listed(role: Role) -> dict[str, list[str]]:
    """Returns the key prefixes that a role may list, by bucket."""
    found: dict[str, list[str]] = {}
    for place in (*role.read, *role.write):
        bucket, _, prefix = place.partition("/")
        found.setdefault(bucket, []).append(prefix)
    return found


def buckets_of(role: Role) -> set[str]:
    """Returns the buckets that a role may access."""
    return {place.partition("/")[0] for place in (*role.read, *role.write)}
