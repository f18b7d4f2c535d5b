"""Decides what a run is confined to: what the settings ask for and what this machine can."""

import logging
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from urllib.parse import urlsplit

from ....schemas.runs.programs import BoxPlan
from ....schemas.settings import Settings
from ....schemas.wire.errors import LaunchError
from ..sandbox.levels import Confinement

_CODE = "InternalServiceError"
_OF_USERS = (".aws", ".ssh", ".gnupg", ".prefect", ".docker", ".kube", ".netrc", ".config", ".s3cfg")
_SQLITE = "sqlite:///"
_DEFAULT_PORTS = {"http": 80, "https": 443}

_logger = logging.getLogger(__name__)


@cache
def _warn_once(text: str) -> None:
    _logger.warning("%s", text)


def plan_box(
    settings: Settings,
    confinement: Confinement,
    user_home: Path | None = None,
    warn: Callable[[str], None] = _warn_once,
    endpoint: str | None = None,
) -> BoxPlan:
    """Decides what a run is confined to.

    Args:
        settings: The service's.
        confinement: The strongest level that this machine has.
        user_home: Home folder of this process's user; None: as the system says.
        warn: Told once what is missing.
        endpoint: URL of the service's endpoint, if this process knows one.

    Raises:
        LaunchError: The settings require more than this machine has.
    """
    if settings.sandbox == "off":
        return BoxPlan()
    level, why = confinement
    lacks = ""
    if level == "none":
        lacks = f"simulation jobs are not confined on this machine: {why}"
    elif level != "box" and settings.sandbox_network != "full":
        lacks = f"the network of simulation jobs cannot be {settings.sandbox_network!r} on this machine: {why}"
    if lacks and settings.sandbox == "require":
        raise LaunchError(
            f"{lacks}; ROBOMAKER_SANDBOX=require refuses to run them so: allow user namespaces, or set it to auto",
            _CODE,
        )
    if lacks:
        warn(f"{lacks} (see `robomaker doctor`)")
    network = settings.sandbox_network if level == "box" else "full"
    servers = (settings.object_store, endpoint or "") if network == "local" else ()
    return BoxPlan(
        level=level,
        network=network,
        services=sorted({port for url in servers if (port := _local_port(url)) is not None}),
        shown=list(settings.sandbox_show),
        hidden=_hidden(settings, user_home or Path.home()),
    )


def _local_port(url: str) -> int | None:
    """The port of a server on this machine; `None`: it is elsewhere, or no server at all."""
    with suppress(ValueError):  # it is no URL
        parts = urlsplit(url)
        if parts.hostname in ("127.0.0.1", "localhost"):
            return parts.port or _DEFAULT_PORTS.get(parts.scheme)
    return None


def _hidden(settings: Settings, user_home: Path) -> list[Path]:
    """Returns paths of the service and of the user that are hidden, even inside folders that are shown."""
    hidden = [settings.home, *(user_home / name for name in _OF_USERS)]
    hidden += [file for file in (settings.access_keys_file, settings.roles_file) if file is not None]
    if settings.object_store.startswith("/"):
        hidden.append(Path(settings.object_store))
    if settings.catalog_url.startswith(_SQLITE):
        catalog = settings.catalog_url.removeprefix(_SQLITE)
        hidden += [Path(catalog + end) for end in ("", "-wal", "-shm", "-journal")]
    return hidden
