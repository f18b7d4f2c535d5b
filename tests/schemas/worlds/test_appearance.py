"""Appearances: light that a file can be given, and nothing else of it."""

import re

import pytest
from helpers.paths import TESTS

from prefect_robomaker.schemas.worlds.appearance import APPEARANCES, appearance_named, relit

EARLIER = TESTS / "tasks" / "worldforge" / "bundle" / "generators" / "2.1.0" / "world.xml"
LIT = ('<texture name="sky"', "<headlight", "<light", '<material name="ceiling"', '<material name="lamp_shade"')


def values(text: str, start: str, attribute: str) -> set[str]:
    return set(re.findall(rf'{re.escape(start)}[^>]* {attribute}="([^"]*)"', text))


@pytest.mark.parametrize("name", APPEARANCES)
def test_only_light_differs_in_a_world_of_an_earlier_generator(name: str) -> None:
    before = EARLIER.read_text()
    after = relit(before, APPEARANCES[name])
    differ = [one for one, other in zip(before.splitlines(), after.splitlines(), strict=True) if one != other]
    assert differ
    assert all(line.strip().startswith(LIT) for line in differ)
    assert values(after, '<light name="sun"', "castshadow") == {"false" if name in ("quick", "lamps") else "true"}


def test_chance_gives_equal_seeds_equal_light_and_others_another() -> None:
    drawn = [appearance_named("random", seed) for seed in range(12)]
    assert drawn == [appearance_named("random", seed) for seed in range(12)]
    assert len(set(drawn)) == 12
    assert len({appearance.sky for appearance in drawn}) > 2


def test_an_unknown_name_is_told_with_those_there_are() -> None:
    with pytest.raises(ValueError, match=r"appearance 'dusk'.*day, evening, night, lamps, quick, random"):
        appearance_named("dusk")
