"""Writes systemd units into the folder for a user's own units."""

from collections.abc import Mapping
from pathlib import Path

from ...schemas.wire.errors import ConfigurationError

_FOLDER = Path(__file__).parent
_SETTINGS = "environment"
_UNSAFE = " \t\n\"'`\\%$&;|<>()*?["
"""Characters with a special meaning to systemd, or to a shell that a unit starts."""


def units(programs: Path) -> dict[str, str]:
    """Returns the texts of the systemd units by file name.

    Args:
        programs: Folder of `robomaker` and `prefect`.

    Raises:
        ConfigurationError: Systemd cannot take its path.
    """
    if found := "".join(character for character in str(programs) if character in _UNSAFE):
        raise ConfigurationError(f"{programs} cannot be in a unit: a path without {found!r} would be right")
    paths = sorted([*_FOLDER.glob("*.service"), *_FOLDER.glob("*.timer")])
    return {path.name: path.read_text().replace("@BIN@", str(programs)) for path in paths}


def places(environ: Mapping[str, str]) -> tuple[Path, Path]:
    """Returns the folder of the user's systemd units, and the path of their settings file."""
    configuration = Path(environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
    return configuration / "systemd" / "user", configuration / "robomaker" / _SETTINGS


def install(programs: Path, environ: Mapping[str, str]) -> list[Path]:
    """Writes the systemd units, and their settings file unless it exists.

    Args:
        programs: Folder of `robomaker` and `prefect`.
        environ: Environment variables, which say where configurations are.

    Returns:
        Paths of the written files.

    Raises:
        ConfigurationError: A file cannot be written.
    """
    folder, settings = places(environ)
    written: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in units(programs).items():
            (folder / name).write_text(text)
            written.append(folder / name)
        settings.parent.mkdir(parents=True, exist_ok=True)
        if not settings.exists():
            settings.touch(mode=0o600)
            settings.write_text((_FOLDER / _SETTINGS).read_text())
            written.append(settings)
    except OSError as error:
        raise ConfigurationError(f"the units cannot be written: {error.filename}: {error.strerror}") from error
    return written
