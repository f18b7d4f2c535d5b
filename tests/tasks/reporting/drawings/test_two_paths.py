"""Two paths on one plan: where each robot was, and the marks of both."""

import itertools
import re
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.reporting.drawings.svg_writing import Frame
from prefect_robomaker.tasks.reporting.drawings.two_paths import (
    Goal,
    Miss,
    Way,
    draw_bare_paths,
    draw_two_paths,
    place_at,
)


@given(st.lists(st.integers(0, 100), min_size=1, max_size=20, unique=True), st.floats(-1, 101))
def test_a_place_is_between_two_points_of_the_path(times: list[int], time_s: float) -> None:
    path = [(float(each), 2.0 * each, -1.0 * each) for each in sorted(times)]
    place = place_at(path, time_s)
    if min(times) <= time_s <= max(times):
        assert place == pytest.approx((2 * time_s, -time_s))
    else:
        assert place is None


def test_both_ways_their_misses_and_goals_are_drawn_where_they_are(make_world: Any, make_result: Any) -> None:
    world = World.model_validate_json(make_world().world_json.read_bytes())
    frame = Frame.of_world(world)
    late = make_result("PASS", 22)
    missed = Miss("gentle", late.path[30][0])
    ways = [Way("A", make_result("FAIL", 12)), Way("B", late, missed)]
    goals = [Goal("there", (1.0, 1.0), 0.5), Goal("sleep", room="Bedroom")]
    root = ElementTree.fromstring(draw_two_paths(world, frame, "w", ways, goals, "Paths of <A> and B"))
    by_class = {node.get("class"): node for node in root.iter() if node.get("class")}

    x, y = frame.at(late.path[30][1:])
    assert by_class["miss side-b"].get("transform") == f"translate({x:.1f} {y:.1f})".replace(".0 ", " ").replace(
        ".0)", ")"
    )
    assert "miss side-a" not in by_class
    for letter, way in zip("ab", ways, strict=True):
        line = by_class[f"way side-{letter}"]
        assert len(line.get("points", "").split()) == len(line.get("data-times", "").split()) == len(way.path)
        assert by_class[f"robot side-{letter}"].get("visibility") == "hidden"
    assert len([node for node in root.iter() if node.get("class") == "floor asked"]) == 1
    assert "goal" in by_class
    assert root.findtext("title") == "Paths of <A> and B"


def test_nothing_is_drawn_of_no_path(make_result: Any) -> None:
    still = make_result("FAIL", 0)
    assert draw_bare_paths([Way("A", still)], [Goal("there", (1.0, 1.0))], "Paths") is None


@pytest.mark.parametrize(("right", "up"), [(0, 0), (0.6, 0), (0, 0.4), (0, -0.4), (0.5, 0.25), (-0.6, -0.1)])
def test_the_words_at_both_ends_do_not_cover_each_other(make_result: Any, right: float, up: float) -> None:
    ends = ((5.0, 5.0), (5.0 + right, 5.0 + up))  # of a drawing 10 m wide: 0.1 m are about 10 units
    ways = [
        Way(
            letter,
            make_result("PASS", 1).model_copy(update={"path": [(0.0, 0.0, 0.0), (5.0, 10.0, 10.0), (9.0, *end)]}),
        )
        for letter, end in zip("AB", ends, strict=True)
    ]
    drawing = str(draw_bare_paths(ways, [], "two"))
    found = re.findall(
        r'class="end-of[^"]*" transform="translate\(([-\d.]+)[ ,]([-\d.]+)\)".*?<text y="([-\d.]+)"', drawing
    )
    [(x, y), (other_x, other_y)] = [(float(x), float(y) + float(down)) for x, y, down in found]

    assert abs(x - other_x) >= 55 or abs(y - other_y) >= 20, "a text of 20 units is about 55 wide"


def test_words_do_not_cover_each_other_where_robots_hardly_moved(make_result: Any) -> None:
    ways = [
        Way(letter, make_result("PASS", 1).model_copy(update={"path": [(0.0, 0.0, 0.0), (9.0, far, 0.0)]}))
        for letter, far in (("A", 0.01), ("B", 0.02))
    ]
    world = [Goal("there", (9.0, 9.0))]
    drawing = str(draw_bare_paths(ways, world, "two"))
    found = re.findall(
        r'transform="translate\(([-\d.]+)[ ,]([-\d.]+)\)"[^>]*>(?:<[^t][^>]*>)*<text y="([-\d.]+)">([^<]*)', drawing
    )
    ys = {words: float(y) + float(down) for _, y, down, words in found}
    assert {"start", "A end", "B end"} <= set(ys)
    near = sorted(ys[each] for each in ("start", "A end", "B end"))
    assert min(b - a for a, b in itertools.pairwise(near)) >= 20
