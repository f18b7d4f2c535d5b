"""Files that a command is to write, by their options; checked before anything takes long."""

from pathlib import Path

from ....schemas.wire.errors import ConfigurationError


def output_file(path: str | None, option: str) -> Path | None:
    """Returns the absolute path of an output file.

    Args:
        path: what was given; None: nothing.
        option: where it was given, for the error.

    Raises:
        ConfigurationError: it is a folder, or in one that does not exist.
    """
    if path is None:
        return None
    file = Path(path).absolute()
    if not path or file.is_dir() or not file.parent.is_dir():
        raise ConfigurationError(f"{option} is {path}; it has to be a file in a folder that exists")
    return file
