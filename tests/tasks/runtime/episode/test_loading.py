import json
import sys
from pathlib import Path

import pytest
from helpers.paths import BUNDLES

from prefect_robomaker.tasks.runtime.episode.loading import LoadError, load_factory

TROUBLE = BUNDLES / "trouble"


@pytest.fixture(autouse=True)
def clean_imports(monkeypatch: pytest.MonkeyPatch):
    """Imports of a test are undone; in a run each process has its own."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        del sys.modules[name]


def test_from_a_bundle() -> None:
    factory = load_factory("trouble.agent.make_agent", TROUBLE)
    assert factory(None, None)("anything") == 0.0


def test_installed() -> None:
    assert load_factory("json.dumps") is json.dumps


def test_attributes_of_classes() -> None:
    assert load_factory("json.decoder.JSONDecoder.decode") is json.decoder.JSONDecoder.decode


@pytest.mark.parametrize(
    ("attribute", "path", "text"),
    [
        ("troubl.agent.make_agent", TROUBLE, "the bundle has no package troubl (needed for troubl.agent.make_agent)"),
        ("troubl.agent.make_agent", TROUBLE, "did you mean trouble?; it contains trouble"),
        ("trouble.agnt.make_agent", TROUBLE, "trouble has no agnt (needed for trouble.agnt.make_agent), did you mean"),
        ("trouble.agnt.make_agent", TROUBLE, "did you mean agent?; it has agent, arena, broken"),
        ("trouble.agent.make", TROUBLE, "trouble.agent has no make (needed for trouble.agent.make)"),
        ("trouble.broken.make_agent", TROUBLE, "importing trouble.broken failed: No module named 'a_lib"),
        ("trouble.arena.not_callable", TROUBLE, "trouble.arena.not_callable is a int, not a function"),
        ("json.dumps", TROUBLE, "not from the bundle: another application or an installed"),
        ("no_such_package.x", None, "there is no installed package no_such_package"),
        ("make_agent", None, "'make_agent' is not a dotted path like `package.module.make_environment`"),
        ("my-nav.make", None, "'my-nav.make' is not a dotted path"),
        ("trouble.agent.make_agent", TROUBLE / "gone", "gone does not exist"),
    ],
)  # fmt: skip
def test_what_is_wrong(attribute: str, path: Path | None, text: str) -> None:
    with pytest.raises(LoadError) as caught:
        load_factory(attribute, path)
    assert text in str(caught.value)


def test_an_empty_bundle(tmp_path: Path) -> None:
    with pytest.raises(LoadError, match="it contains no Python package at all"):
        load_factory("my_nav.make", tmp_path)


def test_a_syntax_error_is_quoted(tmp_path: Path) -> None:
    (tmp_path / "my_nav.py").write_text("def make(:\n")
    with pytest.raises(LoadError, match=r"importing my_nav failed: SyntaxError: .* \(my_nav.py, line 1\)"):
        load_factory("my_nav.make", tmp_path)
