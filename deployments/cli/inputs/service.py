"""The service that a command works with."""

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ....tasks.service.service import Service


def open_service() -> "Service":
    """Opens the service that the environment variables describe; only commands that need one wait for its imports.

    Raises:
        ConfigurationError: a setting leads nowhere.
        StorageError: the object store does not answer.
    """
    from ....schemas.settings import Settings
    from ....tasks.service.service import Service

    return Service.open(Settings.from_environment(os.environ))
