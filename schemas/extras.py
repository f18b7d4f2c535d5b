"""Commands that install optional dependencies of this package."""

from pathlib import Path


def how_to_install(extra: str) -> str:
    """Returns the shell command that installs an optional dependency group ("extra") of this package.

    Args:
        extra: Name of the extra in `pyproject.toml`.

    Returns:
        A command line: of uv in a checkout, whose lock has the versions that were tested together; else of pip.
    """
    # Links of a wheel's layout lead into the checkout.
    checkout = Path(__file__).resolve().parents[1]
    if (checkout / "uv.lock").is_file():
        return f"cd {checkout} && .tools/bin/uv sync --frozen --inexact --extra {extra}"
    return f"pip install 'prefect-robomaker[{extra}]'"
