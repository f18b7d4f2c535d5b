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


PLURAL = re.compile(r"\}\}? (?:more )?(?:jobs|trials|worlds|robots)\b")
"""A count and a fixed plural, `{count} jobs`: of one there would be `1 jobs`, so `counted` has to make the words."""
NEVER_ONE = (
    "all {jobs} jobs take",
    "all {self.rows} trials went",
    "all {count} trials",
    "{count} jobs of this run went",
    "{fewest_pairs(asked.alpha)} trials at least",
    "runs of {fixed} trials",
    "{successes} successes of {trials} trials",
    "{FEWEST_WORLDS} worlds",
    "{count} worlds would be made",
    "are {total} worlds",
    "{len(names)} worlds",
    "{count} of {total} jobs",
    "takes {needed:,} trials",
    "takes {FEWEST_TRIALS} trials",
    "all {total} jobs",
)
"""Counts that are above one wherever these are said."""


def test_one_of_something_is_no_plural() -> None:
    found = [
        f"{path.relative_to(REPOSITORY)}:{number}: {line.strip()}"
        for folder in ("deployments", "flows", "schemas", "tasks")
        for pattern in ("*.py", "*.j2")
        for path in (REPOSITORY / folder).rglob(pattern)
        for text in [path.read_text()]
        if PLURAL.search(text)
        for number, line in enumerate(text.splitlines(), 1)
        if PLURAL.search(line) and "== 1" not in line and not any(each in line for each in NEVER_ONE)
    ]

    assert found == []
