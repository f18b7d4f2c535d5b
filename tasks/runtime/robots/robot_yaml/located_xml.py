"""XML parser whose elements know their lines in the file."""

import xml.etree.ElementTree as ET
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from .mapping import invalid

_MAX_DEPTH = 100
"""Maximum nesting depth of elements: a URDF has five, and very deep documents overflow the stack."""


class Located(ET.Element):
    """An XML element that knows its line in the file."""

    line: int = 1
    """Line of the file in which the element's tag begins, from 1."""


def parse_located(path: Path) -> Located:
    """Parses an XML file into elements that know their line; names keep prefixes such as `xacro:`.

    Args:
        path: The file.

    Raises:
        LaunchError: The file cannot be read, or is not XML.
    """
    builder = ET.TreeBuilder(element_factory=Located)
    # Without namespaces: a prefix that is bound to nothing is no error, and `xacro:` can be told.
    parser = expat.ParserCreate()
    depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _MAX_DEPTH:
            here = f"{path}:{parser.CurrentLineNumber}"
            raise invalid(here, f"<{tag}> is nested more than {_MAX_DEPTH} deep; is the end of an element missing?")
        element = builder.start(tag, attributes)
        assert isinstance(element, Located)
        element.line = parser.CurrentLineNumber

    parser.StartElementHandler = start

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(path.read_bytes(), True)
        root = builder.close()
    except (expat.ExpatError, UnicodeDecodeError, LookupError, OSError, ValueError) as cause:
        raise invalid(path, f"it is no XML: {cause}") from cause
    assert isinstance(root, Located)
    return root


def lined_text(root: Located) -> str:
    """Returns an XML document as text with each tag in its original line, so that MuJoCo's errors name that line.

    Args:
        root: Root element of the document. Text between tags is left out: neither URDF nor its extensions for MuJoCo
            have any.
    """
    parts: list[str] = []
    line = 1

    def write(element: ET.Element) -> None:
        nonlocal line
        behind = element.line - line if isinstance(element, Located) else 0
        if behind > 0:
            parts.append("\n" * behind)
            line += behind
        parts.append("".join((f"<{element.tag}", *(f" {key}={_quoted(value)}" for key, value in element.items()), ">")))
        for child in element:
            write(child)
        parts.append(f"</{element.tag}>")

    write(root)
    return "".join(parts)


def _quoted(value: str) -> str:
    """Returns an attribute's value quoted for XML; line breaks in it become spaces, as XML reads them."""
    return quoteattr(" ".join(value.splitlines()) if "\n" in value else value)
