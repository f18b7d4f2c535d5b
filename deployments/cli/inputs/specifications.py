"""Reading files that the user names."""

from pathlib import Path

from ....schemas.specs.model import CheckedSpec
from ....schemas.wire.errors import ConfigurationError, Place, Problem, SpecError
from ...spec_runs.specifications import SHIPPED, checked


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
    shipped = SHIPPED / f"{path}.yaml"
    is_shipped = "." not in path and "/" not in path and not Path(path).exists() and shipped.is_file()
    return checked(read_text(str(shipped) if is_shipped else path), path)
