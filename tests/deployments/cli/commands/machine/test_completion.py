"""Completion, in a real shell."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

BIN = Path(sys.executable).parent
OFFERED = {
    "robomaker rep": {"report", "repro"},
    "robomaker world sh": {"show", "sheet"},
    "robomaker call DescribeWorldG": {"DescribeWorldGenerationJob"},
    "robomaker report --ju": {"--junit"},
    "robomaker report -o ": {"text", "json"},
    "robomaker report n": {"night-2", "night-1"},
    "robomaker validate n": {"night.yaml"},
}


def completed(lines: list[str], folder: Path) -> list[set[str]]:
    """Returns the words that bash offers after each line."""
    script = 'eval "$(robomaker completion bash)"\n'
    for line in lines:
        script += f"""
            COMP_LINE={line!r} COMP_POINT={len(line)} COMP_TYPE=9 COMP_CWORD={len(line.split(" ")) - 1}
            COMP_WORDS=({line})
            COMPREPLY=()
            _python_argcomplete robomaker
            printf '%s\\n' "${{COMPREPLY[@]}}"
            echo END
        """
    environment = {"PATH": f"{BIN}:/usr/bin:/bin", "HOME": str(folder), "ROBOMAKER_HOME": str(folder / "home")}
    found = subprocess.run(
        ["bash", "-c", script], cwd=folder, env=environment, capture_output=True, text=True, timeout=240, check=True
    )
    assert not found.stderr
    *answers, rest = found.stdout.split("END\n")
    assert rest == ""
    return [{word.strip() for word in answer.splitlines() if word.strip()} for answer in answers]


@pytest.mark.parametrize(
    "lines",
    [
        pytest.param(["robomaker call DescribeWorldG", "robomaker report n"], id="some"),
        pytest.param(list(OFFERED), id="all", marks=pytest.mark.deep),
    ],
)
def test_bash_offers_what_fits(tmp_path: Path, lines: list[str]) -> None:
    for run in ("night-1", "night-2"):
        (tmp_path / "home" / "runs" / run).mkdir(parents=True)
        (tmp_path / "home" / "runs" / run / "run.json").write_text("{}")
    for name in ("night.yaml", "notes.txt"):
        (tmp_path / name).touch()

    assert completed(lines, tmp_path) == [OFFERED[line] for line in lines]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_has_its_code(robomaker: Any, shell: str) -> None:
    code = robomaker("completion", shell)
    assert code.code == 0
    assert "robomaker" in code.out
