"""Checks the import contracts of `pyproject.toml`.

The import linter walks folders, and the package's folders only come together by links.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("schemas", "tasks", "flows", "deployments")


def check_contracts(root: Path) -> subprocess.CompletedProcess[str]:
    """Runs the import linter over the package whose folders are in `root`, with the contracts there."""
    with tempfile.TemporaryDirectory() as scratch:
        package = Path(scratch, "prefect_robomaker")
        package.mkdir()
        package.joinpath("__init__.py").touch()
        for folder in FOLDERS:
            package.joinpath(folder).symlink_to(root / folder)
        return subprocess.run(
            [Path(sys.executable).with_name("lint-imports"), "--no-cache", "--config", str(root / "pyproject.toml")],
            env={**os.environ, "PYTHONPATH": scratch},
            capture_output=True,
            text=True,
            check=False,
            cwd=scratch,
        )


if __name__ == "__main__":
    answer = check_contracts(ROOT)
    sys.stdout.write(answer.stdout + answer.stderr)
    sys.exit(answer.returncode)
