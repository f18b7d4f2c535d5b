"""Makes AWS SDKs find the API model: by an environment variable, or from their model folder.

boto3 and the AWS CLI look for models in the folders of `AWS_DATA_PATH`, then in `~/.aws/models`, then
among their own, which have none of RoboMaker any more.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ...schemas.wire.errors import ConfigurationError

SERVICE = "service-2.json"
PAGINATORS = "paginators-1.json"
WAITERS = "waiters-2.json"
ENDPOINT_RULES = "endpoint-rule-set-1.json"
FILES = (SERVICE, PAGINATORS, WAITERS, ENDPOINT_RULES)

DATA_PATH = Path(__file__).parent / "models"
"""Folder that `AWS_DATA_PATH` must name so that AWS SDKs find the API model."""

_INSIDE = Path("robomaker", "2018-06-29")
MODEL_FOLDER = DATA_PATH / _INSIDE
"""Folder of the API model's files."""

FULL_NAME = "RoboMaker on Prefect"
"""Full service name in the API model, which distinguishes it from other models."""


@dataclass(frozen=True)
class Installation:
    """Result of installing or removing the API model for AWS SDKs, file by file."""

    folder: Path
    """Folder in which AWS SDKs find the API model."""

    written: tuple[str, ...] = ()
    """Names of API model files that were new."""

    replaced: tuple[str, ...] = ()
    """Names of API model files whose content was replaced."""

    removed: tuple[str, ...] = ()
    """Names of deleted API model files."""

    @property
    def changed(self) -> bool:
        """Whether any API model file was changed."""
        return bool(self.written or self.replaced or self.removed)


def data_path(environment: Mapping[str, str]) -> str:
    """Returns the value for `AWS_DATA_PATH` with which AWS SDKs find the API model."""
    folders = [each for each in environment.get("AWS_DATA_PATH", "").split(os.pathsep) if each]
    ours = str(DATA_PATH)
    return os.pathsep.join([ours, *(each for each in folders if each != ours)])


def installed_folder() -> Path:
    """Returns the folder in which AWS SDKs of this user find the API model without settings."""
    return Path.home() / ".aws" / "models" / _INSIDE


def install(*, force: bool = False) -> Installation:
    """Installs the API model for this user's AWS SDKs.

    Args:
        force: Whether a model from elsewhere is replaced.

    Raises:
        ConfigurationError: A model from elsewhere is there.
    """
    folder = installed_folder()
    ours = {name: (MODEL_FOLDER / name).read_bytes() for name in FILES}
    there = {name: (folder / name).read_bytes() for name in FILES if (folder / name).exists()}
    different = tuple(name for name in there if there[name] != ours[name])
    if different and not force and not _is_ours(folder):
        raise ConfigurationError(
            f"{folder} holds another model ({', '.join(different)}); move it away, or replace it with --force"
        )
    absent = tuple(name for name in FILES if name not in there)
    folder.mkdir(parents=True, exist_ok=True)
    for name in (*absent, *different):
        fresh = folder / f".{name}.{os.getpid()}"
        fresh.write_bytes(ours[name])
        fresh.replace(folder / name)
    return Installation(folder, written=absent, replaced=different)


def uninstall() -> Installation:
    """Removes the installed API model.

    Raises:
        ConfigurationError: A model from elsewhere is there.
    """
    folder = installed_folder()
    there = tuple(name for name in FILES if (folder / name).exists())
    if not there:
        return Installation(folder)
    if not _is_ours(folder):
        raise ConfigurationError(f"{folder} holds another model, which was not installed from here; it stays")
    for name in there:
        (folder / name).unlink()
    for empty in (folder, folder.parent):
        if not any(empty.iterdir()):
            empty.rmdir()
    return Installation(folder, removed=there)


def _is_ours(folder: Path) -> bool:
    """Whether a folder's model was generated here, by any version."""
    try:
        model = json.loads((folder / SERVICE).read_bytes())
    except (OSError, ValueError):
        return False
    metadata = model.get("metadata") if isinstance(model, dict) else None
    return isinstance(metadata, dict) and metadata.get("serviceFullName") == FULL_NAME
