"""Two nights of trials, as users see them: compare, report, history and the table of results count each trial."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from helpers.cartpole_spec import PACKAGE, poles

from prefect_robomaker.schemas.reports.comparison import Comparison
from prefect_robomaker.schemas.reports.run_record import RunRecord


@pytest.mark.deep
def test_a_night_in_which_all_trials_became_worse(
    robomaker_at_server: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The robot pushes the other way, so that the pole falls in every trial."""
    monkeypatch.setenv("PYTHONPATH", str(PACKAGE))
    monkeypatch.syspath_prepend(str(PACKAGE))
    spec = tmp_path / "poles.yaml"
    text = poles("trials: {seeds: 8}").replace('TIME_LIMIT_S: "0.5"', 'TIME_LIMIT_S: "3"')
    runs = []
    for gain, code in (("1", 0), ("-1", 1)):
        spec.write_text(text.replace('GAIN: "1"', f'GAIN: "{gain}"'))
        ended = robomaker_at_server("run", spec, "-o", "json")
        assert ended.code == code, ended.err
        runs.append(RunRecord.model_validate_json(ended.out))

    compared = robomaker_at_server("compare", runs[0].run_id, "latest")
    assert compared.code == 1, compared.err
    assert compared.out.startswith(f"Worse: {runs[1].run_id} passes less often than {runs[0].run_id}, by more than")
    assert "  how sure      8 pairs judged in both runs, p = 0.0078 (exact McNemar test" in compared.out
    assert "  what differs  its request\n" in compared.out
    assert "upright: newly missed in 8 of 8 trials; the seed is the same, but the request differs\n" in compared.out
    assert "trial 0: leaned 0.5" in compared.out
    found = Comparison.model_validate_json(robomaker_at_server("compare", runs[0].run_id, "latest", "-o", "json").out)
    assert (found.pairs, found.trials) == (1, 8)
    assert found.rate is not None
    assert (found.rate.before, found.rate.after) == (1, 0)

    summary = json.loads(robomaker_at_server("report", "latest", "-o", "json").out)
    assert (summary["trials"], summary["success"]["failed"]) == (8, 8)
    assert "0 of 8 judged trials passed" in (runs[1].run_dir / "report.html").read_text()
    [changed] = summary["since_last"]["requirements"]
    assert (changed["name"], changed["newly_missed"]) == ("upright", 8)
    history = json.loads(robomaker_at_server("history", "poles", "-o", "json").out)
    assert [night["success"]["passed"] for night in history["nights"]] == [8, 0]

    table = pq.read_table(runs[1].run_dir / "results.parquet").to_pylist()
    assert [(row["trial"], row["outcome"], row["requirement.upright"]) for row in table] == [
        (number, "failed", False) for number in range(8)
    ]
    assert [row["seed"] for row in table] == list(range(8))
