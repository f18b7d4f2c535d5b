"""The map of all rooms in `docs/architecture.md`, from the first sentences of their docstrings."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

_LAYERS = ("prefect_robomaker", "deployments", "flows", "tasks", "schemas")
_BEGIN, _END = "<!-- made: rooms -->\n", "<!-- end -->"


def with_rooms(text: str, root: Path) -> str:
    """Makes the map anew between its marks; what stands around it stays.

    Args:
        text: the page.
        root: the folder of the repository.

    Raises:
        ValueError: the page has no marks.
    """
    before, begin, rest = text.partition(_BEGIN)
    _, end, after = rest.partition(_END)
    if not begin or not end:
        raise ValueError(f"the page has no {_BEGIN.strip()} with {_END} after it")
    rows = ["| room | what lives there |", "| --- | --- |", *_rows(root)]
    return "\n".join([before + begin, *rows, "", end + after])


def _rows(root: Path) -> Iterator[str]:
    for layer in _LAYERS:
        for path in sorted((root / layer).rglob("__init__.py")):
            room = path.parent.relative_to(root)
            if "specs" not in room.parts or room.parts[0] == "schemas":
                docstring = ast.get_docstring(ast.parse(path.read_text())) or ""
                first = re.sub(r"\s+", " ", docstring.partition("\n\n")[0]).rstrip(".")
                yield f"| [`{room}`](../{room}) | {first} |"
