"""What the documentation shows is true: its specifications check, its Python runs, its links lead somewhere."""

import re
from pathlib import Path

import pytest

from prefect_robomaker.deployments.cli.parser import build_parser
from prefect_robomaker.schemas.spec_check import load_spec
from prefect_robomaker.tasks.service import Service

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)


def test_the_first_two_shell_blocks_set_up_and_run_and_set_up_and_test() -> None:
    run, test = blocks(ROOT / "README.md", "bash")

    for command in (run, test):
        assert command.startswith("python3 -m venv .tools && ")
        assert "uv sync" in command
    assert run.rstrip().endswith("robomaker run deployments/specs/quickstart.yaml")
    assert ".venv/bin/pytest" in test


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_specifications_in_the_documentation_are_right(page: Path) -> None:
    for text in blocks(page, "yaml"):
        if "steps:" in text:
            assert load_spec(text, page.name).order


@pytest.mark.parametrize("path", sorted((ROOT / "deployments" / "specs").glob("*.yaml")), ids=lambda path: path.name)
def test_the_example_specifications_are_right(path: Path) -> None:
    assert load_spec(path.read_text(), str(path)).order


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_python_in_the_documentation_runs(page: Path, service: Service, prefect_server: str) -> None:
    with service.activated():
        for number, text in enumerate(blocks(page, "python")):
            exec(compile(text, f"{page.name}, block {number}", "exec"), {})


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=lambda page: page.name)
def test_links_to_files_lead_somewhere(page: Path) -> None:
    targets = re.findall(r"\]\(([^)#]+)", page.read_text())

    missing = [target for target in targets if "://" not in target and not (page.parent / target).exists()]
    assert missing == []


def test_the_readme_lists_the_commands_there_are() -> None:
    listed = set(re.findall(r"^\| `robomaker ([a-z-]+)", (ROOT / "README.md").read_text(), re.MULTILINE))
    help_text = build_parser().format_help()

    assert listed == set(re.findall(r"^    ([a-z-]+) {2,}", help_text, re.MULTILINE))
