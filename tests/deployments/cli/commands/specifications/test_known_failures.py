"""run: failures that are known do not make a run red, and everything shows them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from helpers.cartpole_spec import PACKAGE, poles

Command = Callable[..., Any]
WriteSpec = Callable[[str], Path]

MISSES = "requirements: [{name: quick, kind: time_limit, limit_s: 0.1}]"
KNOWN = """\
known:
  - match: {job: "request 1 *", requirement: quick}
    owner: anna
    until: 2999-01-01
    why: ticket 512
  - match: {requirement: gone}
    owner: ben
    until: 2999-01-01
"""


def test_a_known_failure_is_judged_and_shown_and_a_new_one_is_red(
    robomaker_at_server: Command, spec: WriteSpec, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(PACKAGE))
    junit, markdown = tmp_path / "junit.xml", tmp_path / "report.md"

    known = robomaker_at_server("run", spec(KNOWN + poles(MISSES, "seed: 1")))

    assert known.code == 0, known.err
    assert "poles: succeeded, 1 of 2 jobs passed, 1 failure known, after" in known.out
    assert "known, anna until 2999-01-01: ticket 512" in known.out
    assert "(ben) marks no failure: no job has a requirement `gone`; there are upright, quick" in known.out
    [run] = (home / "runs").iterdir()
    page = (run / "report.html").read_text()
    assert 'href="#known"' in page
    assert 'href="#failures"' not in page
    assert "1 of 2 jobs passed; 1 failed, 1 of the failures is known" in page
    assert "the known failure of gone" in page
    shown = robomaker_at_server("report", run.name, "--junit", junit, "--markdown", markdown)
    assert shown.code == 0, shown.err
    suites = ElementTree.parse(junit).getroot()
    assert (suites.get("failures"), suites.get("errors")) == ("0", "0")
    assert [each.get("message") for each in suites.iter("skipped")] == ["known, anna until 2999-01-01: ticket 512"]
    assert "failed (known, `anna until 2999-01-01: ticket 512`)" in markdown.read_text()

    new = robomaker_at_server("run", spec(KNOWN + poles("seed: 1", MISSES)))

    assert new.code == 1, new.err
    assert "0 failures known" not in new.out
    assert "poles: failed, 1 of 2 jobs passed, after" in new.out


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{match: {job: a}, owner: anna, until: 2999-01-01}", "known[0].match.requirement"),
        ("{match: {requirement: quick}, until: 2999-01-01}", "known[0].owner"),
        ("{match: {requirement: quick}, owner: anna, until: soon}", "known[0].until"),
        ("{match: {requirment: quick}, owner: anna, until: 2999-01-01}", "known[0].match.requirment"),
    ],
)
def test_what_is_wrong_is_told_at_its_place(robomaker: Command, spec: WriteSpec, entry: str, said: str) -> None:
    ended = robomaker("validate", spec(f"known: [{entry}]\n{poles('seed: 1')}"))
    assert ended.code == 2
    assert ":1:" in ended.err
    assert said in ended.err
