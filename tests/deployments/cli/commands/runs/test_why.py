"""The documentation's run of poles, whose robot is too weak in some trials, says so at its end."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.cartpole_spec import PACKAGE
from helpers.paths import REPOSITORY

from prefect_robomaker.tasks.causes.stored import read_why


@pytest.mark.deep
def test_the_documented_run_finds_the_weak_motor(
    robomaker_at_server: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(PACKAGE))
    monkeypatch.syspath_prepend(str(PACKAGE))
    page = (REPOSITORY / "docs" / "trials.md").read_text()
    [text] = [block for block in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL) if "name: poles-why" in block]
    (tmp_path / "poles-why.yaml").write_text(text)

    ended = robomaker_at_server("run", tmp_path / "poles-why.yaml")

    assert ended.code == 1, ended.err
    said, documented = (
        re.search(r"why: (upright: \d+ trials missed it first; gain < .*, in these worlds only)", each)
        for each in (ended.out, page)
    )
    assert said is not None
    assert documented is not None
    assert said[1] == documented[1]
    place = re.search(r"record +(\S+)/run\.json", ended.out)
    assert place is not None
    why = read_why(Path(place[1]))
    assert why is not None
    assert [claim.axes for claim in why.groups[0].claims] == [["gain"]]
