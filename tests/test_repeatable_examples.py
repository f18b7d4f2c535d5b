"""Whole runs try the same examples each time, whatever else their processes imported."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st


def drawn() -> list[tuple[int, float, str]]:
    """The examples of one test."""
    examples: list[tuple[int, float, str]] = []

    @settings(max_examples=300)  # one in twenty is a constant
    @given(st.integers(), st.floats(), st.text())
    def collect(number: int, share: float, word: str) -> None:
        examples.append((number, share, word))

    collect()
    return examples


def test_a_module_that_was_imported_before_changes_no_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = drawn()
    (tmp_path / "imported_meanwhile.py").write_text(
        "\n".join(
            f"N{i} = {7_919 * i + 104_729}\nF{i} = {i}.{i}25\nW{i} = 'word {i}'" for i in range(60)
        )  # of many, none is taken
    )
    spec = spec_from_file_location("imported_meanwhile", tmp_path / "imported_meanwhile.py")
    assert spec is not None
    module = module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "imported_meanwhile", module)

    assert repr(drawn()) == repr(first)
