"""run --against: what cannot be asked is refused before anything is run."""

from pathlib import Path
from typing import Any

import pytest
from helpers.cartpole_spec import poles
from helpers.night_records import make_job, make_night, store_night

from prefect_robomaker.deployments.cli.commands.specifications.run import again
from prefect_robomaker.deployments.cli.grammar import build_parser
from prefect_robomaker.schemas.reports.challenge import Challenge
from prefect_robomaker.schemas.reports.live_comparison import AgainstAnswer
from prefect_robomaker.schemas.reports.run_record import RunRecord

RUN = "nightly-20260301T020000000"


def night(verdicts: str, home: Path, step: str = "balance", **changes: Any) -> RunRecord:
    jobs = [make_job(number, each).model_copy(update={"step": step}) for number, each in enumerate(verdicts)]
    record = make_night(jobs, runs=home / "runs").model_copy(update=changes)
    store_night(record)
    return record


EARLY = AgainstAnswer(
    run_id="older", alpha=0.05, answer="better", why="decided after 8 of 12 pairs", pairs=8, planned=12, saved=4,
    stopped_early=True,
)  # fmt: skip


@pytest.mark.parametrize(
    ("stored", "words", "told"),
    [
        ({}, ["--margin", "5"], "--margin is about --against, which is not given; name the earlier run"),
        ({}, ["--alpha", "0.05"], "--alpha is about --against, which is not given; name the earlier run"),
        ({}, ["--against", "none"], "there is no run 'none' in "),
        ({}, ["--against", RUN, "--alpha", "1"], "--alpha is 1; it has to be above 0 and below 1, such as 0.05"),
        ({}, ["--against", RUN, "--alpha", "nan"], "--alpha is nan; it has to be above 0 and below 1, such as 0.05"),
        ({}, ["--against", RUN, "--margin", "0"], "--margin is '0'; a number above 0 and below 100, such as 5, would"),
        ({"step": "drive"}, ["--against", RUN], "a run of nightly that has no simulation jobs of this specification's "
         "steps (balance) to pair with; a run of the same specification would do"),
        ({"verdicts": ""}, ["--against", RUN], "a run of nightly that has no simulation jobs of this specification's"),
        ({"state": "canceled"}, ["--against", RUN], f"--against is {RUN}, which was not finished (canceled)"),
        ({"against": EARLY}, ["--against", RUN], f"--against is {RUN}, which itself stopped early against older"),
        ({"probe": True}, ["--against", RUN], f"--against is {RUN}, which is a probe of a forecast, with smaller"),
        ({"probe": True, "challenge": Challenge(sabotages=[])}, ["--against", RUN],
         f"--against is {RUN}, which is a challenge, with robots that were sabotaged; a whole run would do"),
        ({}, ["--against", RUN], f"--against is {RUN}, of which no job has the step, seed and axes of a job of poles, "
         "so that there are no pairs; a run of the same specification would do"),
        ({"verdicts": "PPPFFFF"}, ["--against", RUN], "whose 7 trials cannot decide anything at --alpha 0.05"),
    ],
)  # fmt: skip
def test_what_cannot_be_asked_is_refused_in_one_sentence(
    robomaker: Any, home: Path, tmp_path: Path, stored: dict[str, Any], words: list[str], told: str
) -> None:
    night(**{"verdicts": "F" * 20, "home": home, **stored})
    spec = tmp_path / "poles.yaml"
    spec.write_text(poles("seed: 1"))
    ended = robomaker("run", spec, *words)
    assert (ended.code, ended.out) == (2, "")
    assert told in ended.err
    assert len(ended.err.strip().splitlines()) == 1
    assert [path.name for path in (home / "runs").iterdir()] == [RUN]


def test_a_run_that_has_not_ended_is_refused(robomaker: Any, home: Path, tmp_path: Path) -> None:
    night("F" * 20, home)
    (home / "runs" / "going").mkdir()
    (home / "runs" / "going" / "order.json").touch()
    spec = tmp_path / "poles.yaml"
    spec.write_text(poles("seed: 1"))
    ended = robomaker("run", spec, "--against", "going")
    assert ended.code == 2
    assert "--against is going, which has not ended; a run that has would do" in ended.err


def test_the_command_that_does_the_same_again_asks_the_same() -> None:
    words = ["run", "a.yaml", "--against", RUN, "--alpha", "0.01", "--margin", "5"]
    assert again(build_parser().parse_args(words), {}) == ["robomaker", *words]
