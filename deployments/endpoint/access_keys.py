"""The access keys that clients of the endpoint have to sign with."""

import configparser
import logging
import stat
from pathlib import Path

from ...schemas.wire.errors import ConfigurationError

_ID, _SECRET = "aws_access_key_id", "aws_secret_access_key"

_logger = logging.getLogger(__name__)


def read_access_keys(path: Path) -> dict[str, str]:
    """Reads a file in the form of `~/.aws/credentials`; the names of its profiles do not matter.

    Returns:
        The secret access keys by id.

    Raises:
        ConfigurationError: the file cannot be read, or it holds no keys.
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
    keys: dict[str, str] = {}
    for profile in (parser.default_section, *parser.sections()):
        values = parser[profile]
        access_key, secret = values.get(_ID, ""), values.get(_SECRET, "")
        if bool(access_key) != bool(secret):
            raise ConfigurationError(_advice(path, f"[{profile}] has only one of {_ID} and {_SECRET}"))
        if access_key:
            keys[access_key] = secret
    if not keys:
        raise ConfigurationError(_advice(path, "it holds no keys"))
    return keys


def _advice(path: Path, problem: str) -> str:
    return f"ROBOMAKER_ACCESS_KEYS_FILE is '{path}'; it has to have the form of ~/.aws/credentials, and {problem}"
