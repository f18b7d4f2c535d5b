"""A run that is carried out beside an earlier one, as users see it: it stops when it is decided."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.cartpole_spec import PACKAGE
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.reports.comparison import Comparison
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.tasks.jobs.request_order import mixed_order

JOBS = 20
"""Eight pairs decide; on a busy machine a few more jobs end before the others are cancelled."""


def poles() -> str:
    """The specification on the page about comparison, with fewer seeds; poles fall where the gain is -1."""
    page = (REPOSITORY / "docs" / "comparison.md").read_text()
    [text] = [block for block in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL) if "\nsteps:" in block]
    assert "        seeds: 30\n" in text
    return text.replace("        seeds: 30\n", f"        seeds: {JOBS}\n")


def with_seeds(seeds: list[int]) -> str:
    """The specification of the page with a list of seeds, in an order of its own."""
    listed = poles().replace(
        f"        seeds: {JOBS}\n        value:\n",
        f"        forEach: {seeds}\n        value:\n          seed: ${{{{ item }}}}\n",
    )
    assert "forEach" in listed
    return listed


@pytest.mark.deep
@pytest.mark.timeout(600)
def test_a_run_that_is_clearly_better_stops_early(
    robomaker_at_server: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(PACKAGE))
    monkeypatch.syspath_prepend(str(PACKAGE))
    spec = tmp_path / "poles.yaml"
    spec.write_text(poles())
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


@pytest.mark.deep
@pytest.mark.timeout(600)
def test_a_decided_run_with_more_jobs_than_the_earlier_one_ends_with_the_answer(
    robomaker_at_server: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(PACKAGE))
    monkeypatch.syspath_prepend(str(PACKAGE))
    total, paired = 40, 8  # eight pairs are the fewest that decide
    # The pairs come first, so that all of them run and the jobs that are cancelled have none.
    few, many = mixed_order([{}] * total)[:paired], list(range(total))
    spec = tmp_path / "poles.yaml"
    spec.write_text(with_seeds(few))
    first = RunRecord.model_validate_json(robomaker_at_server("run", spec, "--set", "gain=-1", "-o", "json").out)
    assert len(first.jobs) == paired

    after = "  after: {operation: ListWorlds, needs: [balance], input: {}}\n"
    spec.write_text(with_seeds(many) + after)
    ended = robomaker_at_server("run", spec, "--against", first.run_id)
    record = RunRecord.model_validate_json(
        max(tmp_path.rglob("run.json"), key=lambda path: path.parent.name).read_text()
    )
    ran = sum(job.status == "Completed" for job in record.jobs)
    assert paired <= ran < total
    found = record.against
    assert found is not None
    assert (found.answer, found.pairs, found.planned, found.saved, found.unpaired, found.skipped) == (
        "better", paired, paired, 0, total - ran, ["after"],
    )  # fmt: skip
    assert (ended.code, record.state, found.stopped_early) == (0, "succeeded", True)
    assert (
        f"better than {first.run_id}: decided after 8 of 8 pairs; {total - ran} jobs without a pair were not run; "
        "not run since it was decided: after\n"
    ) in ended.out


@pytest.mark.deep
@pytest.mark.timeout(600)
def test_seeds_that_change_nothing_decide_nothing(
    robomaker_at_server: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All poles begin at the same angle: 10 pairs that all get better are one pair, for the run and for `compare`."""
    shutil.copytree(PACKAGE, tmp_path / "bundle")
    arena = tmp_path / "bundle" / "my_cartpole" / "arena.py"
    text = arena.read_text()
    assert "self._rng.uniform(-0.05, 0.05)" in text
    arena.write_text(text.replace("self._rng.uniform(-0.05, 0.05)", "0.03"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "bundle"))
    monkeypatch.syspath_prepend(str(tmp_path / "bundle"))
    spec = tmp_path / "poles.yaml"
    spec.write_text(poles().replace("seeds: 30", "seeds: 10"))
    before = RunRecord.model_validate_json(robomaker_at_server("run", spec, "--set", "gain=-1", "-o", "json").out)
    ended = robomaker_at_server("run", spec, "--against", before.run_id, "-o", "json")
    found = RunRecord.model_validate_json(ended.out).against
    assert found is not None
    assert (ended.code, found.answer) == (6, "no difference shown"), ended.err
    assert "repeat another pair state by state" in found.why
    compared = robomaker_at_server("compare", before.run_id, "latest", "-o", "json")
    assert compared.code == 6
