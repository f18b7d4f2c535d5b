"""The access keys that clients have to sign with, read from a file, and what each is good for."""

import configparser
import logging
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

from ....schemas.wire.errors import ConfigurationError
from ....schemas.wire.request_problems import nearest

Scope = Literal["read", "submit", "administer"]
SCOPES: tuple[Scope, ...] = get_args(Scope)
"""Scopes of access keys, narrowest first; each includes those before it."""

_ID, _SECRET = "aws_access_key_id", "aws_secret_access_key"

_SCOPE, _NAMES, _TAGS = "robomaker_scope", "robomaker_names", "robomaker_tags"
_PREFIX = "robomaker_"

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class AccessKey:
    """An access key of the API server, with its rights."""

    id: str
    secret: str = field(repr=False)
    name: str = ""
    """Name of the key's profile in the file, used in the audit log."""

    scope: Scope = "administer"
    names: tuple[str, ...] = ()
    """Prefixes of the names of resources that an access key may access."""

    tags: tuple[str, ...] = ()
    """Prefixes of the tags of resources that an access key may access, written `key=value`."""

    @property
    def is_confined(self) -> bool:
        """Whether the access key is restricted to some resources."""
        return bool(self.names or self.tags)

    def permits(self, name: str | None, tags: Mapping[str, str]) -> bool:
        """Whether an access key permits access to a resource with a given name and tags."""
        written = [f"{key}={value}" for key, value in tags.items()]
        named = name is not None and name.startswith(self.names)
        return not self.is_confined or named or any(each.startswith(self.tags) for each in written)


def read_access_keys(path: Path) -> dict[str, AccessKey]:
    """Reads the access keys file, in the form of `~/.aws/credentials`.

    Returns:
        The access keys by id.

    Raises:
        ConfigurationError: The file cannot be read, or it holds no keys.
    """
    parser = configparser.RawConfigParser(strict=False)
    try:
        if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            _logger.warning("others can read the access keys in %s; chmod 600 keeps them to yourself", path)
        parser.read_string(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(f"ROBOMAKER_ACCESS_KEYS_FILE is '{path}': {error.strerror}") from error
    except (configparser.Error, UnicodeDecodeError):
        # Not the parser's own words: they quote the line, which may be a secret.
        raise ConfigurationError(_advice(path, "it cannot be read as one")) from None
    keys: dict[str, AccessKey] = {}
    for profile in (parser.default_section, *parser.sections()):
        values = parser[profile]
        access_key, secret = values.get(_ID, ""), values.get(_SECRET, "")
        if bool(access_key) != bool(secret):
            raise ConfigurationError(_advice(path, f"[{profile}] has only one of {_ID} and {_SECRET}"))
        if access_key:
            keys[access_key] = _access_key(path, profile, access_key, secret, values)
    if not keys:
        raise ConfigurationError(_advice(path, "it holds no keys"))
    return keys


def _access_key(path: Path, profile: str, key: str, secret: str, values: Mapping[str, str]) -> AccessKey:
    known = (_SCOPE, _NAMES, _TAGS)
    for member in values:
        if member.startswith(_PREFIX) and member not in known:
            raise ConfigurationError(_advice(path, f"[{profile}] has {member}{nearest(member, known)}"))
    given = values.get(_SCOPE, "administer")
    by_name: dict[str, Scope] = {each: each for each in SCOPES}
    scope = by_name.get(given)
    if scope is None:
        wanted = ", ".join(SCOPES)
        raise ConfigurationError(_advice(path, f"[{profile}] has {_SCOPE} = {given}; it has to be one of {wanted}"))
    names, tags = (tuple(values.get(member, "").replace(",", " ").split()) for member in (_NAMES, _TAGS))
    for member, prefixes in ((_NAMES, names), (_TAGS, tags)):
        if member in values and not prefixes:  # which would lift what it was written to limit
            raise ConfigurationError(_advice(path, f"[{profile}] has {member} without a value"))
    return AccessKey(key, secret, profile.removeprefix("profile "), scope, names, tags)


def _advice(path: Path, problem: str) -> str:
    return f"ROBOMAKER_ACCESS_KEYS_FILE is '{path}'; it has to have the form of ~/.aws/credentials, and {problem}"
