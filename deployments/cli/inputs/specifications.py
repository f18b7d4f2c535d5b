"""Reading files that the user names."""

import os
from pathlib import Path

from ....schemas.settings import max_worlds_per_job
from ....schemas.specs.check import load_spec
from ....schemas.specs.model import CheckedSpec
from ....schemas.specs.world_counts import check_world_counts
from ....schemas.wire.errors import ConfigurationError, Place, Problem, SpecError

_SHIPPED = Path(__file__).parents[2] / "specs"
"""Folder of the specifications that come with this package."""


class InputFileError(ConfigurationError):
    """A file that the user named cannot be read."""


def read_text(path: str) -> str:
    """Reads a text file.

    Raises:
        InputFileError: it cannot be opened.
        SpecError: it is no text.
    """
    try:
        return Path(path).read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputFileError(f"{path}: {(error.strerror or str(error)).lower()}") from error
    except UnicodeDecodeError as error:
        problem = Problem(Place(path, 1, 1), "", f"this is not UTF-8 text: {error.reason} at byte {error.start}")
        raise SpecError([problem]) from error


def read_spec(path: str) -> CheckedSpec:
    """Reads and checks a specification.

    Args:
        path: a file; or `quickstart` or `nightly`, if there is no such file: they come with this package.

    Raises:
        InputFileError: it cannot be opened.
        SpecError: it has problems.
    """
    shipped = _SHIPPED / f"{path}.yaml"
    is_shipped = "." not in path and "/" not in path and not Path(path).exists() and shipped.is_file()
    spec = load_spec(read_text(str(shipped) if is_shipped else path), path)
    check_world_counts(spec, max_worlds_per_job(os.environ))
    return spec
