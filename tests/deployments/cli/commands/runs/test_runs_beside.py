"""A run that is carried out beside an earlier one, as users see it: it stops when it is decided."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.cartpole_spec import PACKAGE
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.reports.comparison import Comparison
from prefect_robomaker.schemas.reports.run_record import RunRecord

JOBS = 30
"""Jobs of the example in `docs/comparison.md`, with as many seeds; poles fall where the robot pushes the wrong way."""


@pytest.mark.deep
@pytest.mark.timeout(600)
def test_a_run_that_is_clearly_better_stops_early(
    robomaker_at_server: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(PACKAGE))
    monkeypatch.syspath_prepend(str(PACKAGE))
    spec = tmp_path / "poles.yaml"
    page = (REPOSITORY / "docs" / "comparison.md").read_text()
    [text] = [block for block in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL) if "\nsteps:" in block]
    spec.write_text(text)
    first = RunRecord.model_validate_json(robomaker_at_server("run", spec, "--set", "gain=-1", "-o", "json").out)
    assert {job.verdict for job in first.jobs} == {"FAIL"}

    ended = robomaker_at_server("run", spec, "--against", first.run_id)
    assert ended.code == 0, ended.err
    record = RunRecord.model_validate_json(
        max(tmp_path.rglob("run.json"), key=lambda path: path.parent.name).read_text()
    )
    assert f"better than {first.run_id}: decided after 8 of {JOBS} pairs; " in ended.out
    assert record.against is not None
    found = record.against
    assert (found.answer, found.pairs, found.planned, record.state, record.exit_code) == (
        "better", 8, JOBS, "succeeded", 0,
    )  # fmt: skip
    ran = [job for job in record.jobs if job.status == "Completed"]
    assert 8 <= len(ran) < JOBS
    assert found.saved == JOBS - len(ran)

    compared = robomaker_at_server("compare", first.run_id, record.run_id, "-o", "json")
    comparison = Comparison.model_validate_json(compared.out)
    assert (compared.code, comparison.answer, comparison.rate) == (0, "better", None)
    assert comparison.e_values["better"] == pytest.approx(68.3, abs=0.1)
