"""Code and pages use the words of the trade, and plain sentences."""

import re

from helpers.paths import REPOSITORY

FOLDERS = ("deployments", "docs", "flows", "prefect_robomaker", "schemas", "tasks", "tools")
TEXTS = {".py", ".md", ".j2", ".yaml", ".json", ".js"}

STORED = ('"performer"', "facts.performer")
"""Names in health answers, which stay."""

BETTER = {
    "whoever": "name the process or person, such as the job worker",
    "nobody": "say what is not done, such as: no job worker holds it",
    "what became of": "name the result or the status",
    "performer": "job worker",
}


def test_texts_use_plain_words() -> None:
    stay = re.compile("|".join(map(re.escape, STORED)))
    # In text of small letters, which is searched six times as fast as text of any.
    words = re.compile(rf"\b(?:{'|'.join(BETTER)})")
    paths = [*REPOSITORY.glob("*.md"), *(path for folder in FOLDERS for path in (REPOSITORY / folder).rglob("*"))]
    found = [
        f"{path.relative_to(REPOSITORY)}:{number}: {word}: {BETTER[word]}"
        for path in paths
        if path.suffix in TEXTS
        for text in [path.read_text().lower()]
        if words.search(text)
        for number, line in enumerate(text.splitlines(), 1)
        for word in words.findall(stay.sub("", line))
    ]

    assert found == []


FRAGMENT = re.compile(
    r'(?:^\s*"""|description="|optional\(\s*")(?:What|Who|Whose|Where|Which|Of|By|In|To)\b.*'
    r'|^\s*"""(?:How|Why|When|Until|Since)\b.*',
    re.MULTILINE,
)
"""First lines of docstrings, and descriptions, that say nothing without the name above them."""


def test_docstrings_and_descriptions_begin_as_sentences_or_nouns() -> None:
    found = [
        f"{path.relative_to(REPOSITORY)}: {each[0].strip()}"
        for folder in ("deployments", "flows", "prefect_robomaker", "schemas", "tasks", "tools")
        for path in (REPOSITORY / folder).rglob("*.py")
        if path.name != "ros_packages.py"  # what exports have stays as it is, to the byte
        for each in FRAGMENT.finditer(path.read_text())
    ]
    assert found == []
