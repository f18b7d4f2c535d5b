"""How the problems of specifications are shown."""

import os
import sys
from collections.abc import Sequence

from ....schemas.wire.errors import Problem


def print_problems(problems: Sequence[Problem]) -> None:
    """Prints problems to standard error; in GitHub's workflows also as annotations of the file."""
    for problem in problems:
        sys.stderr.write(f"{problem}\n")
    files = {problem.place.file for problem in problems}
    count = f"{len(problems)} problem{'s' if len(problems) > 1 else ''}"
    sys.stderr.write(f"robomaker: {count} in {', '.join(sorted(files))}; nothing was run\n")
    if os.environ.get("GITHUB_ACTIONS") == "true":
        for problem in problems:
            sys.stderr.write(f"{annotation(problem)}\n")


def annotation(problem: Problem) -> str:
    """A problem as a GitHub workflow command."""
    text = f"{problem.path}: {problem.message}" if problem.path else problem.message
    escaped = text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
    place = problem.place
    return f"::error file={place.file},line={place.line},col={place.column}::{escaped}"
