"""Print how boto3 and the AWS CLI find RoboMaker's service model.

eval "$(robomaker sdk-model)" makes those of one shell find it, --install those of this user.
"""

import argparse
import os
import shlex
from typing import Any

from .....schemas.wire.errors import ConfigurationError
from ....service_model.installation import MODEL_FOLDER, Installation, data_path, install, installed_folder, uninstall
from ...arguments import add_output
from ...output.answers import print_either


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker sdk-model` to its parser."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--install", action="store_true", help="copy it to ~/.aws/models, where they look anyway")
    where.add_argument("--uninstall", action="store_true", help="remove it from there")
    parser.add_argument("--force", action="store_true", help="with --install: replace a model from elsewhere")
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker sdk-model`: shows, installs or removes the API model by which AWS SDKs know RoboMaker.

    Raises:
        ConfigurationError: A model from elsewhere is in the way, or `--force` has nothing to force.
    """
    if arguments.force and not arguments.install:
        raise ConfigurationError("--force belongs to --install; nothing was done")
    done = None
    if arguments.install:
        done = install(force=arguments.force)
    elif arguments.uninstall:
        done = uninstall()
    print_either(arguments.output, _as_data(done), _lines(done))
    return 0


def _lines(done: Installation | None) -> list[str]:
    if done is None:
        return [
            f"# RoboMaker's service model for boto3 and the AWS CLI: {MODEL_FOLDER}",
            "# They find it with this line, or without any after `robomaker sdk-model --install`:",
            f"export AWS_DATA_PATH={shlex.quote(data_path(os.environ))}",
        ]
    parts = {"written": done.written, "replaced": done.replaced, "removed": done.removed}
    lines = [f"{what} {done.folder / name}" for what, names in parts.items() for name in names]
    return lines or [f"Nothing to do in {done.folder}."]


def _as_data(done: Installation | None) -> dict[str, Any]:
    data: dict[str, Any] = {
        "model": str(MODEL_FOLDER),
        "environment": {"AWS_DATA_PATH": data_path(os.environ)},
        "installedAt": str(installed_folder()),
    }
    if done is not None:
        data |= {"written": done.written, "replaced": done.replaced, "removed": done.removed}
    return data
