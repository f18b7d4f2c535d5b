"""SVG's `<use>`, `<symbol>` and inner `<svg>`: what they show is where browsers draw it, and never without end."""

import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.schemas.worlds.world import Point
from prefect_robomaker.tasks.worldforge.drawings.drawn_shapes import Drawing
from prefect_robomaker.tasks.worldforge.drawings.svg import read_svg

NUMBERS = st.integers(-9, 9)
TRANSFORMS = st.one_of(
    st.builds("translate({} {})".format, NUMBERS, NUMBERS),
    st.builds("scale({} {})".format, st.integers(1, 3), st.sampled_from([-1, 1, 2])),
    st.builds("rotate({} {} {})".format, st.sampled_from([30, 90, 180]), NUMBERS, NUMBERS),
)


def read(inside: str, more: str = "") -> Drawing:
    text = f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" {more}>{inside}</svg>'
    return read_svg(text.encode(), "flat.svg")


def corners(drawing: Drawing) -> list[Point]:
    return [point for shape in drawing.shapes for point in shape.points]


@given(TRANSFORMS, TRANSFORMS, TRANSFORMS, NUMBERS, NUMBERS)
@examples(60)
def test_a_use_of_a_use_is_drawn_where_groups_would_put_it(one: str, two: str, three: str, x: int, y: int) -> None:
    shown = read(
        f'''<defs><rect id="a" class="room" width="4" height="2" transform="{one}"/>
        <g id="b" transform="{two}"><use xlink:href="#a" x="{x}"/></g></defs>
        <use href="#b" y="{y}" transform="{three}"/>'''
    )
    drawn = read(
        f'''<g transform="{three}"><g transform="translate(0 {y})"><g transform="{two}">
        <g transform="translate({x})"><rect class="room" width="4" height="2" transform="{one}"/></g></g></g></g>'''
    )
    assert [pytest.approx(point) for point in corners(shown)] == corners(drawn)


@pytest.mark.parametrize(
    ("symbol", "use", "expected"),
    [
        ("", 'x="5" y="6"', (5, 6, 15, 26)),
        ('viewBox="0 0 10 20"', 'x="5" width="20" height="40"', (5, 0, 25, 40)),
        ('viewBox="0 0 10 20" width="20" height="40"', "", (0, 0, 20, 40)),
        ('viewBox="0 0 10 20" width="9" height="9"', 'width="20" height="40"', (0, 0, 20, 40)),
        ('viewBox="-5 -5 20 40"', 'width="20" height="40"', (5, 5, 15, 25)),
        ('viewBox="0 0 10 20"', 'width="40" height="40"', (10, 0, 30, 40)),
        ('viewBox="0 0 10 20" preserveAspectRatio="xMinYMax"', 'width="40" height="40"', (0, 0, 20, 40)),
        ('viewBox="0 0 10 20" preserveAspectRatio="xMaxYMin slice"', 'width="40" height="40"', (0, 0, 40, 80)),
        ('viewBox="0 0 10 20" preserveAspectRatio="none"', 'width="40" height="40"', (0, 0, 40, 40)),
        ('viewBox="0 0 10 20"', "", (25, 0, 75, 100)),
        ('viewBox="0 0 10 20"', 'width="50%" height="50%"', (12.5, 0, 37.5, 50)),
    ],
)
def test_symbols_fill_their_viewports(symbol: str, use: str, expected: tuple[float, ...]) -> None:
    drawing = read(
        f'<symbol id="s" {symbol}><rect class="room" width="10" height="20"/></symbol><use href="#s" {use}/>',
        'viewBox="0 0 100 100"',
    )
    [shape] = drawing.shapes
    west, south, east, north = shape.box
    assert (west, -north, east, -south) == pytest.approx(expected)


def test_an_inner_svg_has_a_place_and_a_size_of_its_own() -> None:
    drawing = read(
        '<svg x="3" y="4" width="20" height="20" viewBox="0 0 10 10"><rect id="Bath" width="5" height="5"/></svg>'
    )
    assert drawing.shapes[0].box == pytest.approx((3, -14, 13, -4))


def test_classes_names_and_states_of_a_use_are_those_of_what_it_shows() -> None:
    drawing = read(
        """<defs><path id="leaf" d="M0 0V9"/><symbol id="door90"><path d="M0 0V9"/></symbol></defs>
        <use id="to-bath" class="door" href="#leaf" data-open="30"/><use class="shut" href="#door90" x="40"/>"""
    )
    bath, other = drawing.shapes
    assert (bath.name, bath.place, bath.facts["open"]) == ("to-bath", '<use> "to-bath"', "30")
    assert (bath.words, other.words) == (("leaf", "door", "to-bath"), ("door90", "shut"))
    assert other.name == ""


@pytest.mark.parametrize(
    ("inside", "chain"),
    [
        ('<g id="a"><use href="#a"/></g>', '"a" in "a"'),
        ('<g id="a"><use href="#b"/></g><g id="b"><use href="#a"/></g>', "inside of itself"),
        ('<symbol id="s"><use href="#u"/></symbol><use id="u" href="#s"/>', "inside of itself"),
    ],
)
def test_what_shows_itself_is_refused(inside: str, chain: str) -> None:
    with pytest.raises(ConfigurationError, match=r"^flat\.svg: <use> shows something inside of itself: ") as refused:
        read(inside)
    assert chain in str(refused.value)


def doubling(leaf: str, times: int = 20) -> str:
    groups = "".join(f'<g id="g{n}"><use href="#g{n - 1}"/><use href="#g{n - 1}"/></g>' for n in range(1, times))
    return f'<defs><g id="g0">{leaf}</g>{groups}</defs><use href="#g{times - 1}"/>'


BOMBS = {
    "nothing": (doubling(""), "more than 20,000 elements"),
    "lines": (doubling('<line x2="1"/>' * 8), "more than 20,000 elements"),
    "corners": (doubling(f'<polyline points="{"1,2 " * 9000}"/>'), "more than 500,000 corners together"),
    "texts": (doubling(f"<text>{'long ' * 100_000}</text>"), "more than 20,000 elements"),
    "transforms": (doubling(f'<g transform="{"rotate(1) " * 900}"/>'), "more than 20,000 elements"),
    "long paths": (doubling(f'<path d="M0 0{" 1 2" * 20_000}"/>'), "more than "),
    "one layer of doors": ('<g class="door">' + '<line x2="1"/>' * 3000 + "</g>", "more than 2,000 shapes of doors"),
    "deep": (
        "".join(f'<g id="g{n}"><use href="#g{n - 1}"/></g>' for n in range(1, 999)) + '<g id="g0"/>',
        "more than 100 groups inside one another",
    ),
}


@pytest.mark.parametrize(
    "bomb", [pytest.param(bomb, marks=[pytest.mark.deep] if bomb in ("corners", "lines") else []) for bomb in BOMBS]
)
def test_files_that_multiply_end_with_an_error(bomb: str) -> None:
    """Without limits each of these takes hours."""
    inside, expected = BOMBS[bomb]
    with pytest.raises(ConfigurationError, match=expected):
        read(inside)
