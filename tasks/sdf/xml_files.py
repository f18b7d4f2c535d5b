"""Reads untrusted XML files: size, entities and depth are limited, errors name the line."""

import xml.etree.ElementTree as ET
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from xml.parsers import expat

from .sdf_types import SdfError

MOST_XML_BYTES = 20 * 1024 * 1024
"""Limit of an XML file's size, in bytes; the largest public world file has 3 MB."""
_MOST_DEPTH = 200
"""Limit of nested XML elements; included models are files of their own."""
_MOST_ELEMENTS = 2_000_000
_MOST_LISTED = 10_000
"""Limit of the files of a folder that are compared for similar names."""


class Element(ET.Element):
    """An XML element that knows its line in the file."""

    line: int = 0
    file: str = ""


def read_bytes(path: Path, most_bytes: int) -> bytes:
    """Reads a regular file of limited size.

    Args:
        path: The file.
        most_bytes: The largest that is read.

    Raises:
        SdfError: The file does not exist, is not a regular file, is too large, or cannot be read.
    """
    try:
        if not path.exists():
            raise SdfError(f"{path}: it does not exist{similar_to(path)}")
        if not path.is_file():
            what = "a folder" if path.is_dir() else "no regular file"
            raise SdfError(f"{path}: it is {what}; a file would be right")
        if (size := path.stat().st_size) > most_bytes:
            raise SdfError(f"{path}: it has {size:,} bytes; at most {most_bytes:,} are read")
        return path.read_bytes()
    except OSError as error:
        raise SdfError(f"{path}: it cannot be read: {error.strerror}") from error


def similar_to(path: Path) -> str:
    """Returns the end of an error message about a missing file: similarly named files in its folder, if it has some.

    It is empty if the folder cannot be read.
    """
    try:
        if not path.parent.is_dir():
            return f"; there is no folder {path.parent}"
        names = {each.name.lower(): each.name for each in islice(path.parent.iterdir(), _MOST_LISTED)}
    except OSError:
        return ""
    # 0.6: `hose.world` and `house_2.world` are similar to `house.world`.
    near = [names[name] for name in get_close_matches(path.name.lower(), names, n=3, cutoff=0.6)]
    alike = [name for name in names.values() if name not in near and Path(name).suffix == path.suffix]
    found = [*near, *sorted(alike)][:3]
    return f"; in its folder there is {', '.join(found)}" if found else f"; its folder has no {path.suffix} file"


def read_xml(path: Path) -> Element:
    """Reads an XML file.

    An XML declaration that comes after a comment is tolerated, as some public worlds have it there.

    Raises:
        SdfError: The file is not well-formed XML, has a DOCTYPE, or is too large; the message has file and line.
    """
    content = read_bytes(path, MOST_XML_BYTES)
    start = content.find(b"<?xml")
    if start > 0 and b"<sdf" not in content[:start]:
        # Lines stay where they are, so that errors name them.
        content = b"\n" * content[:start].count(b"\n") + content[content.find(b"?>", start) + 2 :]
    return _Reader(path).read(content.lstrip(b"\xef\xbb\xbf"))


def parse_xml(content: bytes) -> Element:
    """Parses XML text into elements that know their line.

    Args:
        content: The text.

    Raises:
        SdfError: The text is not well-formed XML.
    """
    return _Reader(Path("built in")).read(content)


class _Reader:
    """Builds elements from an XML parser's events."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._parser = expat.ParserCreate()
        self._parser.StartDoctypeDeclHandler = self._doctype
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.buffer_text = True
        self._open: list[Element] = []
        self._root: Element | None = None
        self._count = 0

    def read(self, content: bytes) -> Element:
        try:
            self._parser.Parse(content, True)
        except expat.ExpatError as error:
            raise SdfError(f"{self._path}:{error.lineno}: it is not well-formed XML: {expat.errors.messages[error.code]}") from None  # fmt: skip # noqa: E501
        if self._root is None:
            raise SdfError(f"{self._path}: it has no XML element")
        return self._root

    def _doctype(self, *declared: object) -> None:
        del declared
        line = self._parser.CurrentLineNumber
        raise SdfError(f"{self._path}:{line}: it declares a DOCTYPE, which can hide entities; world files need none")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        line = self._parser.CurrentLineNumber
        if len(self._open) >= _MOST_DEPTH or self._count > _MOST_ELEMENTS:
            raise SdfError(f"{self._path}:{line}: its elements are nested deeper than {_MOST_DEPTH}, or too many")
        element = Element(tag, attributes)
        element.line, element.file = line, str(self._path)
        if self._open:
            self._open[-1].append(element)
        else:
            self._root = element
        self._open.append(element)

    def _end(self, tag: str) -> None:
        del tag
        self._open.pop()

    def _text(self, text: str) -> None:
        if self._open and not len(self._open[-1]):
            self._open[-1].text = (self._open[-1].text or "") + text


def place(element: ET.Element) -> str:
    """Returns file and line of an XML element, for messages."""
    return f"{getattr(element, 'file', '')}:{getattr(element, 'line', 0)}"


def text_of(parent: ET.Element, tag: str, otherwise: str = "") -> str:
    """Returns the text of an XML child element, stripped."""
    child = parent.find(tag)
    return otherwise if child is None or child.text is None else child.text.strip()


def numbers_of(
    element: ET.Element | None, count: int, otherwise: tuple[float, ...], *, is_endless: bool = False
) -> tuple[float, ...]:
    """Parses the numbers in an XML element.

    Args:
        element: The element; absent: what is meant otherwise.
        count: Required number of numbers.
        otherwise: Value of an absent or empty element.
        is_endless: Whether numbers may be as large as one likes, also infinite: limits that are none.

    Raises:
        SdfError: The text is not the wanted count of finite numbers.
    """
    if element is None or not (element.text or "").strip():
        return otherwise
    said = (element.text or "").split()
    try:
        values = tuple(float(each) for each in said)
    except ValueError:
        values = ()
    if len(values) != count or not all(abs(value) < 1e12 or (is_endless and value == value) for value in values):
        raise SdfError(
            f"{place(element)}: <{element.tag}> is {' '.join(said)[:80]!r}; {count} finite "
            f"{'number' if count == 1 else 'numbers'} would be right"
        )
    return values


def number_of(parent: ET.Element, tag: str, otherwise: float, *, is_endless: bool = False) -> float:
    """Parses the number in an XML child element.

    Raises:
        SdfError: The text is not a finite number.
    """
    return numbers_of(parent.find(tag), 1, (otherwise,), is_endless=is_endless)[0]


def flag_of(parent: ET.Element, tag: str, otherwise: bool = False) -> bool:
    """Whether an XML child element says `true` or `1`."""
    said = text_of(parent, tag).lower()
    return otherwise if not said else said in ("true", "1")
