"""Commands that install optional dependencies of this package."""

import importlib.metadata
import re
from contextlib import suppress
from pathlib import Path


def how_to_install(extra: str) -> str:
    """Returns the shell command that installs an optional dependency group ("extra") of this package.

    Args:
        extra: Name of the extra in `pyproject.toml`.

    Returns:
        A command line: of uv in a checkout, whose lock has the versions that were tested together; else of pip.
    """
    if (checkout := _checkout()) is not None:
        return f"cd {checkout} && .tools/bin/uv sync --frozen --inexact --extra {extra}"
    return f"pip install 'prefect-robomaker[{extra}]'"


def how_to_add(package: str) -> str:
    """Returns the shell command that installs a package beside this one; the environment that uv makes has no pip."""
    checkout = _checkout()
    return f"pip install {package}" if checkout is None else f"cd {checkout} && .tools/bin/uv pip install {package}"


def extras() -> dict[str, bool]:
    """Returns for each optional dependency group ("extra") of this package whether all of its packages are installed.

    It is empty if the package runs from a folder, without metadata.
    """
    found: dict[str, bool] = {}
    with suppress(importlib.metadata.PackageNotFoundError):
        for requirement in importlib.metadata.requires("prefect-robomaker") or ():
            if (match := _OF_EXTRA.match(requirement)) is not None:
                found[match[2]] = found.get(match[2], True) and _is_installed(match[1])
    return found


_OF_EXTRA = re.compile(r"""([\w.-]+).*;.*extra\s*==\s*['"]([\w-]+)['"]""")


def _is_installed(package: str) -> bool:
    try:
        importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def _checkout() -> Path | None:
    """The checkout in which this package lies; `None`: it is installed otherwise."""
    # Links of a wheel's layout lead into the checkout.
    checkout = Path(__file__).resolve().parents[1]
    return checkout if (checkout / "uv.lock").is_file() else None
