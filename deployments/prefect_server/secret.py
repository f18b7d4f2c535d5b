"""The auth string of a home's Prefect server: made once, in a file that only its owner can read."""

import os
import secrets
import stat
from pathlib import Path

from ...schemas.settings import Settings
from ...schemas.wire.errors import ConfigurationError
from ...tasks.service.home import prepare_home

FILE = "auth"
_USER = "robomaker"
_SECRET_BYTES = 32


def server_folder(settings: Settings) -> Path:
    """The folder of the home's server: its database, its log, its secret; for its owner alone.

    Raises:
        ConfigurationError: the data home cannot be used.
    """
    prepare_home(settings)
    folder = settings.home / "prefect"
    folder.mkdir(mode=0o700, exist_ok=True)
    if stat.S_IMODE(folder.stat().st_mode) & 0o077:
        folder.chmod(0o700)  # of a home that was copied
    return folder


def auth_string(settings: Settings) -> str:
    """The auth string of the home's server, `user:secret`; the first call makes it.

    Raises:
        ConfigurationError: the file cannot be read, or others could read it.
    """
    path = server_folder(settings) / FILE
    if not path.exists():
        _make(path)
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
        text = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"the secret of the Prefect server in {path} cannot be read: {error}") from error
    if mode & 0o077:
        raise ConfigurationError(
            f"the secret of the Prefect server in {path} has mode {mode:04o}, so others may have read it; "
            "remove the file and restart the server (robomaker server stop), which makes a new one"
        )
    user, _, secret = text.partition(":")
    if not (user and secret):
        raise ConfigurationError(f"{path} holds no secret; remove it and restart the server (robomaker server stop)")
    return text


def _make(path: Path) -> None:
    """Writes a new secret, unless another process is quicker; the file is never there without its content."""
    temporary = path.with_name(f"{FILE}.{os.getpid()}.{secrets.token_hex(4)}")
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(f"{_USER}:{secrets.token_urlsafe(_SECRET_BYTES)}\n")
    try:
        os.link(temporary, path)
    except FileExistsError:
        pass
    finally:
        temporary.unlink()
