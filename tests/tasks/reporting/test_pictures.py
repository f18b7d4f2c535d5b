import base64
import io

import pytest
from PIL import Image

from prefect_robomaker.tasks.reporting.pictures import PictureError, budget_for_each, embed_picture, embed_svg


def _noise(width: int, height: int) -> bytes:
    buffer = io.BytesIO()
    Image.effect_noise((width, height), 90).convert("RGBA").save(buffer, "PNG")
    return buffer.getvalue()


def _decode(uri: str) -> bytes:
    return base64.b64decode(uri.partition("base64,")[2])


def test_a_picture_shrinks_until_it_fits_its_budget() -> None:
    picture = embed_picture(_noise(1600, 800), budget_bytes=60_000)
    decoded = _decode(picture.uri)
    assert len(decoded) <= 60_000
    with Image.open(io.BytesIO(decoded)) as shown:
        assert shown.size == (picture.width, picture.height)
        assert picture.width == 2 * picture.height


@pytest.mark.parametrize("pictures", [1, 2, 50, 1000])
def test_all_pictures_together_leave_room_in_a_page_of_ten_megabytes(pictures: int) -> None:
    in_base64 = pictures * budget_for_each(pictures) * 4 / 3
    assert 7_500_000 < in_base64 <= 8_000_000


def test_a_small_picture_keeps_its_size() -> None:
    assert embed_picture(_noise(64, 32), budget_bytes=60_000).width == 64


@pytest.mark.parametrize("data", [b"no picture", b"\x89PNG\r\n\x1a\n", _noise(64, 64)[:300]])
def test_what_is_no_picture_is_refused(data: bytes) -> None:
    with pytest.raises(PictureError):
        embed_picture(data, budget_bytes=60_000)


def test_a_harmless_drawing_is_embedded_as_it_is() -> None:
    drawing = (
        '<svg xmlns="http://www.w3.org/2000/svg"><style>.a{fill:url("#p")}</style>'
        '<pattern id="p"/><use href="#p"/><text>Küche</text></svg>'
    )
    assert _decode(embed_svg(drawing)).decode() == drawing


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("<script>alert(1)</script>", "contains <script>"),
        ("<s:script xmlns:s='http://www.w3.org/2000/svg'/>", "contains <s:script>"),
        ("<foreignObject/>", "contains <foreignObject>"),
        ("<rect onload='alert(1)'/>", "event handler onload"),
        ("<use href='http://example.com/x.svg#a'/>", "refers to 'http://example.com"),
        ("<use xmlns:xlink='http://www.w3.org/1999/xlink' xlink:href='data:image/svg+xml,x'/>", "refers to 'data:"),
        ("<a href='javascript:alert(1)'/>", "contains <a>"),
        ("<image href='#x'/>", "contains <image>"),
        ("<rect style='fill: url( \"http://example.com\" )'/>", "refers to another file"),
        ("<style>@import 'x.css';</style>", "style sheet refers"),
        ("<rect>", "not well-formed"),
    ],
)
def test_a_drawing_that_could_do_something_is_refused(content: str, reason: str) -> None:
    with pytest.raises(PictureError, match=reason):
        embed_svg(f'<svg xmlns="http://www.w3.org/2000/svg">{content}</svg>')


def test_entities_are_refused_before_they_expand() -> None:
    bomb = '<!DOCTYPE svg [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><svg>&b;</svg>'
    with pytest.raises(PictureError, match="document type"):
        embed_svg(bomb)


def test_a_document_that_is_no_drawing_is_refused() -> None:
    with pytest.raises(PictureError, match="<html>, not <svg>"):
        embed_svg("<html/>")
