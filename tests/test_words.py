"""Code and pages use the words of the trade, and plain sentences."""

import re
from functools import cache
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY

FOLDERS = ("deployments", "docs", "flows", "prefect_robomaker", "schemas", "tasks", "tools")
TEXTS = {".py", ".md", ".j2", ".yaml", ".json", ".js"}
NOT_CHECKED = {Path("prefect_robomaker/old_paths_table.py")}
"""It has old paths."""

STORED = ('"performer"', "facts.performer", "lost_performers")
"""Names in health answers and databases, which stay."""


@cache
def lines() -> list[tuple[str, str]]:
    """Every line of the product and its pages, with its place; without names that stay."""
    paths = [*REPOSITORY.glob("*.md"), *(path for folder in FOLDERS for path in (REPOSITORY / folder).rglob("*"))]
    stay = "|".join(map(re.escape, STORED))
    return [
        (f"{path.relative_to(REPOSITORY)}:{number}", re.sub(stay, "", line))
        for path in paths
        if path.suffix in TEXTS and path.relative_to(REPOSITORY) not in NOT_CHECKED
        for number, line in enumerate(path.read_text().splitlines(), 1)
    ]


@pytest.mark.parametrize(
    ("word", "better"),
    [
        ("whoever", "name the process or person, such as the job worker"),
        ("nobody", "say what is not done, such as: no job worker holds it"),
        ("what became of", "name the result or the status"),
        ("performer", "job worker"),
    ],
)
def test_texts_use_plain_words(word: str, better: str) -> None:
    found = [where for where, line in lines() if re.search(rf"\b{word}", line, re.IGNORECASE)]

    assert found == [], better
