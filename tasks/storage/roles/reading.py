"""Reading the roles file."""

import json
import stat
import tomllib
from pathlib import Path

from pydantic import ValidationError

from ....schemas.roles import Role, RolesFile
from ....schemas.wire.errors import ConfigurationError
from ....schemas.wire.request_problems import nearest


def read_roles_file(path: Path) -> tuple[Role, ...]:
    """Reads a roles file, which only its owner may read or write: it may hold keys.

    Raises:
        ConfigurationError: it cannot be read, others can, or something in it is wrong; its values are not repeated.
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
    """The roles that the text of a roles file names.

    Args:
        text: TOML.
        where: the file's name, for messages.

    Raises:
        ConfigurationError: something is wrong with it.
    """
    try:
        content = tomllib.loads(text)
        return RolesFile.model_validate_json(json.dumps(content, default=str)).role
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"roles file '{where}': it is no TOML: {error}") from None
    except ValidationError as error:
        raise ConfigurationError(f"roles file '{where}': {_problem(error)}") from None


def _problem(error: ValidationError) -> str:
    """The first problem, without the value: that may be a secret."""
    first = error.errors(include_url=False, include_input=False)[0]
    path = list(first["loc"])
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).lstrip(".")
    if first["type"] == "extra_forbidden":
        known = tuple(Role.model_fields if len(path) > 1 else RolesFile.model_fields)
        return f"{place} is not known{nearest(str(path[-1]), known)}; known are {', '.join(known)}"
    return f"{place}: {first['msg'].removeprefix('Value error, ')}" if place else first["msg"]
