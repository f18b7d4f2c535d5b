"""Data home: the folder with all local data of the service."""

import os

from ...schemas.settings import Settings
from ...schemas.wire.errors import ConfigurationError


def prepare_home(settings: Settings) -> None:
    """Creates the data home folder unless it exists, private to its user.

    One that exists keeps its mode: people share some on purpose.

    Raises:
        ConfigurationError: The path is not a folder, or cannot be created or written to.
    """
    try:
        settings.home.mkdir(0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(_advice(settings, f"cannot be created: {error.strerror}")) from error
    if not os.access(settings.home, os.W_OK | os.X_OK):
        raise ConfigurationError(_advice(settings, "cannot be written to"))


def _advice(settings: Settings, problem: str) -> str:
    return f"the data home {settings.home} {problem}; set ROBOMAKER_HOME to a folder you can write to"
