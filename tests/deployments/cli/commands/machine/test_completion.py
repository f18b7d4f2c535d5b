"""Completion, in a real shell."""

import subprocess
import sys
from pathlib import Path

import pytest

BIN = Path(sys.executable).parent


def completed(line: str, folder: Path) -> list[str]:
    """What bash offers after a line."""
    script = f"""
        eval "$(robomaker completion bash)"
        COMP_LINE={line!r} COMP_POINT={len(line)} COMP_TYPE=9 COMP_CWORD={len(line.split(" ")) - 1}
        COMP_WORDS=({line})
        _python_argcomplete robomaker
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    environment = {"PATH": f"{BIN}:/usr/bin:/bin", "HOME": str(folder), "ROBOMAKER_HOME": str(folder / "home")}
    found = subprocess.run(
        ["bash", "-c", script], cwd=folder, env=environment, capture_output=True, text=True, timeout=60, check=True
    )
    assert not found.stderr
    return [word.strip() for word in found.stdout.splitlines() if word.strip()]


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("robomaker rep", {"report", "repro"}),
        ("robomaker world sh", {"show", "sheet"}),
        ("robomaker call DescribeWorldG", {"DescribeWorldGenerationJob"}),
        ("robomaker report --ju", {"--junit"}),
        ("robomaker report -o ", {"text", "json"}),
        ("robomaker report n", {"night-2", "night-1"}),
        ("robomaker validate n", {"night.yaml"}),
    ],
)
def test_bash_offers_what_fits(tmp_path: Path, line: str, offered: set[str]) -> None:
    for run in ("night-1", "night-2"):
        (tmp_path / "home" / "runs" / run).mkdir(parents=True)
        (tmp_path / "home" / "runs" / run / "run.json").write_text("{}")
    for name in ("night.yaml", "notes.txt"):
        (tmp_path / name).touch()

    assert set(completed(line, tmp_path)) == offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_has_its_code(shell: str) -> None:
    code = subprocess.run(
        [BIN / "robomaker", "completion", shell], capture_output=True, text=True, timeout=60, check=True
    ).stdout
    assert "robomaker" in code
