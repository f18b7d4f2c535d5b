"""The page about the tests' helpers names every one of them."""

import re

from helpers.paths import BUNDLES, TESTS

PAGE = (TESTS / "helpers" / "README.md").read_text()


def test_every_helper_is_listed_and_every_listed_helper_exists():
    listed = re.findall(r"^\| `(\w+)`", PAGE, re.MULTILINE)
    assert sorted(listed) == sorted(path.stem for path in (TESTS / "helpers").glob("*.py") if path.stem != "__init__")


def test_helpers_with_fixtures_are_plugins():
    plugins = re.findall(r'"helpers\.(\w+)"', (TESTS / "conftest.py").read_text())
    assert sorted(plugins) == sorted(re.findall(r"^\| `(\w+)` \*", PAGE, re.MULTILINE))


def test_every_bundle_is_named():
    assert {path.name for path in BUNDLES.iterdir()} <= set(re.findall(r"`(\w+)`", PAGE))
