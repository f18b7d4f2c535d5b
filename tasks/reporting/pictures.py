"""Images embedded in HTML pages, after a check of their size and format."""

import base64
import io
from dataclasses import dataclass
from xml.parsers import expat

from PIL import Image, UnidentifiedImageError

from ...schemas.wire.errors import RobomakerError

_BUDGET_BYTES = 6_000_000
_WIDTHS_PX = (960, 720, 540, 400, 280)
_QUALITY = 82
_MOST_PIXELS = 40_000_000
_FORBIDDEN_ELEMENTS = frozenset(
    {"script", "foreignobject", "iframe", "object", "embed", "image", "audio", "video", "a"}
)


class PictureError(RobomakerError):
    """Raised for an image that cannot be shown; the message says why."""


@dataclass(frozen=True)
class Picture:
    """An image embedded in an HTML page as a `data:` URL."""

    uri: str
    """The `data:` URL."""
    width: int
    height: int


def embed_picture(data: bytes, budget_bytes: int) -> Picture:
    """Encodes an image as JPEG for embedding in a page, within a size limit.

    Args:
        data: PNG, or another format that Pillow reads.
        budget_bytes: Size limit in bytes; if even the smallest width is larger, that one is used.

    Raises:
        PictureError: The bytes are no picture, or one of absurd size.
    """
    try:
        with Image.open(io.BytesIO(data), formats=("PNG", "JPEG", "WEBP")) as opened:
            if opened.width * opened.height > _MOST_PIXELS:
                raise PictureError(f"the picture has {opened.width} × {opened.height} pixels; at most 40 million")
            image = _flattened(opened)
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise PictureError(f"the picture cannot be read: {error}") from error
    encoded, shown = b"", image
    for width in _WIDTHS_PX:
        shown = image if image.width <= width else image.resize((width, round(image.height * width / image.width) or 1))
        buffer = io.BytesIO()
        shown.save(buffer, "JPEG", quality=_QUALITY, optimize=True)
        encoded = buffer.getvalue()
        if len(encoded) <= budget_bytes:
            break
    return Picture(f"data:image/jpeg;base64,{base64.b64encode(encoded).decode()}", shown.width, shown.height)


def _flattened(image: Image.Image) -> Image.Image:
    """Replaces transparency by white, since JPEG has no transparency."""
    if image.mode in ("RGBA", "LA", "P"):
        image = image.convert("RGBA")
        return Image.alpha_composite(Image.new("RGBA", image.size, "white"), image).convert("RGB")
    return image.convert("RGB")


def budget_for_each(pictures: int) -> int:
    """Returns the bytes that each of some images may have so that the page stays below 10 MB."""
    return _BUDGET_BYTES // max(1, pictures)


def embed_svg(text: str) -> str:
    """Converts an SVG to a `data:` URL for an `<img>`, in which scripts and links are dead.

    Raises:
        PictureError: It is not well-formed, or holds something that a drawing does not need: document
            types, scripts, event handlers, foreign content, references to other files.
    """
    root: list[str] = []

    def element_starts(name: str, attributes: dict[str, str]) -> None:
        root.append(name)
        local = name.rpartition(":")[2].lower()
        if local in _FORBIDDEN_ELEMENTS:
            raise PictureError(f"the drawing contains <{name}>")
        for attribute, value in attributes.items():
            _check_attribute(name, attribute.rpartition(":")[2].lower(), value)

    def document_type_starts(*_: object) -> None:
        raise PictureError("the drawing declares a document type")

    def text_comes(content: str) -> None:
        # Only style sheets could load something from here.
        if "@import" in content.lower() or _leads_outside(content):
            raise PictureError("the drawing's style sheet refers to another file")

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler = element_starts
    parser.StartDoctypeDeclHandler = document_type_starts
    parser.CharacterDataHandler = text_comes
    data = text.encode("utf-8", "replace")
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise PictureError(f"the drawing is not well-formed: {error}") from error
    if root[0].rpartition(":")[2] != "svg":
        raise PictureError(f"the drawing is <{root[0]}>, not <svg>")
    return f"data:image/svg+xml;base64,{base64.b64encode(data).decode()}"


def _check_attribute(element: str, attribute: str, value: str) -> None:
    if attribute.startswith("on"):
        raise PictureError(f"the drawing has the event handler {attribute} on <{element}>")
    if attribute in ("href", "src") and not value.strip().startswith("#"):
        raise PictureError(f"the drawing refers to {value[:80]!r}")
    if _leads_outside(value):
        raise PictureError(f"the drawing's {attribute} on <{element}> refers to another file")


def _leads_outside(value: str) -> bool:
    """Returns whether a CSS style refers to anything but a part of its own drawing."""
    compact = "".join(value.lower().split()).replace('"', "").replace("'", "")
    return compact.count("url(") > compact.count("url(#")
