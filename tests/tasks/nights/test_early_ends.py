"""The early end of a run: the answer is kept before jobs are cancelled, and outlives the process and the catalog."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from helpers.cartpole_spec import poles
from helpers.night_records import make_job, make_night, store_night
from helpers.processes import wait_for

from prefect_robomaker.schemas.reports.live_comparison import Against, AgainstAnswer
from prefect_robomaker.schemas.reports.run_record import Interruption, Order, StepRecord
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import ConfigurationError, ServiceUnavailableException
from prefect_robomaker.tasks.nights import early_ends
from prefect_robomaker.tasks.nights.early_ends import EarlyEnd
from prefect_robomaker.tasks.nights.open_runs import OpenRun
from prefect_robomaker.tasks.service.service import Service

SPEC = load_spec(poles("seed: 1"), "poles.yaml")
STEP = StepRecord(name="balance", operation="StartSimulationJobBatch", status="Pending", arn="batch")
ANSWER = AgainstAnswer(
    run_id="old", alpha=0.05, answer="better", why="decided after 8 of 20 pairs", pairs=8, planned=20
)


class Catalog:
    """Notes what is cancelled, and what is known of the answer by then; it may not answer at first."""

    def __init__(self, folder: Path, outages: int = 0) -> None:
        self.cancelled: list[str] = []
        self.kept: list[str] = []
        self._order, self._outages = folder / "order.json", outages

    def request_cancel(self, arn: str) -> None:
        if self._outages:
            self._outages -= 1
            raise ServiceUnavailableException("the catalog is away")
        self.cancelled.append(arn)
        self.kept.append(self._order.read_text() if self._order.is_file() else "")


class Beside:
    """Decides at the third look."""

    def __init__(self, *_: Any) -> None:
        self.looks = 0

    def ended_count(self, _steps: Sequence[StepRecord]) -> int:
        self.looks += 1
        return self.looks

    def answer(self, _steps: Sequence[StepRecord], *, is_over: bool = False) -> AgainstAnswer | None:
        return ANSWER if self.looks >= 3 or is_over else None

    def with_saved(self, answer: AgainstAnswer, _steps: Sequence[StepRecord]) -> AgainstAnswer:
        return answer.model_copy(update={"saved": 5})


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(early_ends, "LOOK_S", 0.001)
    monkeypatch.setattr(early_ends, "RunBeside", Beside)
    monkeypatch.setattr(early_ends, "earlier_run", lambda *_: None)


def begun(folder: Path, **changes: Any) -> OpenRun:
    order = Order(run_id="new", text="", filename="", spec_path="", command=[])
    folder.mkdir(exist_ok=True)
    return OpenRun.begin(folder, order.model_copy(update=changes))


def early(catalog: Catalog, run: OpenRun | None, told: list[Any], home: Path) -> EarlyEnd:
    service = cast(Service, SimpleNamespace(catalog=catalog, settings=SimpleNamespace(home=home)))
    return EarlyEnd(Against(run_id="old", alpha=0.05), SPEC, service, told.append, run)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("outages", [0, 2])
def test_the_answer_is_kept_before_jobs_are_cancelled(tmp_path: Path, outages: int) -> None:
    run, catalog, told = begun(tmp_path / "new"), Catalog(tmp_path / "new", outages), list[Any]()
    end = early(catalog, None, told, tmp_path)
    with end.watching([], STEP, run):
        wait_for(lambda: catalog.cancelled, "jobs to be cancelled", 20)
    assert end.is_decided
    assert catalog.cancelled == ["batch"]
    assert Order.model_validate_json(catalog.kept[0]).decided == ANSWER
    assert [each.text for each in told] == [
        "better than old: decided after 8 of 20 pairs; what still runs is cancelled"
    ]
    assert end.answer([STEP]) == ANSWER.model_copy(update={"saved": 5})
    run.end()


@pytest.mark.usefixtures("quick")
def test_another_process_goes_on_with_the_answer_of_the_one_that_died(tmp_path: Path) -> None:
    run, catalog = begun(tmp_path / "new", decided=ANSWER), Catalog(tmp_path / "new")
    end = early(catalog, run, [], tmp_path)
    assert end.is_decided
    with end.watching([], STEP, run):
        wait_for(lambda: catalog.cancelled, "jobs to be cancelled", 20)
    assert end.answer([STEP]).saved == 5
    run.end()


@pytest.mark.usefixtures("quick")
def test_steps_without_simulations_are_not_watched(tmp_path: Path) -> None:
    end = early(Catalog(tmp_path), None, [], tmp_path)
    with end.watching([], STEP.model_copy(update={"operation": "CreateWorldGenerationJob"}), None):
        pass
    assert not end.is_decided


def test_a_night_goes_on_where_the_earlier_run_is_gone(tmp_path: Path) -> None:
    told: list[Any] = []
    with pytest.raises(ConfigurationError, match="--against is old, whose record cannot be read"):
        early(Catalog(tmp_path), None, told, tmp_path)
    now = make_night("").started_at
    died = Interruption(lost=None, lost_at=now, continued_at=now)
    run = begun(tmp_path / "new", interruptions=[died])
    end = early(Catalog(tmp_path), run, told, tmp_path)
    assert "this run is not compared any more: --against is old" in told[0].text
    found = end.answer([])
    assert (found.answer, found.saved) == ("not comparable", 0)
    run.end()


def test_an_answer_stays_where_the_earlier_run_is_gone_since(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was decided before, and the jobs were cancelled for it."""
    monkeypatch.setattr(early_ends, "LOOK_S", 0.001)
    now = make_night("").started_at
    died = Interruption(lost=None, lost_at=now, continued_at=now)
    run, catalog, told = begun(tmp_path / "new", interruptions=[died], decided=ANSWER), Catalog(tmp_path), list[Any]()
    end = early(catalog, run, told, tmp_path)
    with end.watching([], STEP, run):
        wait_for(lambda: catalog.cancelled, "jobs to be cancelled", 20)
    assert told == []
    found = end.answer([STEP.model_copy(update={"status": "Canceled"})])
    assert found == ANSWER.model_copy(update={"stopped_early": True})
    run.end()


@pytest.mark.usefixtures("quick")
def test_an_answer_stays_where_what_it_saved_cannot_be_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(*_: Any) -> AgainstAnswer:
        raise FileNotFoundError("results.parquet")

    monkeypatch.setattr(Beside, "with_saved", lost)
    run = begun(tmp_path / "new", decided=ANSWER)
    assert early(Catalog(tmp_path), run, [], tmp_path).answer([STEP]).answer == ANSWER.answer
    run.end()


def test_an_earlier_run_of_the_same_steps_is_taken(tmp_path: Path) -> None:
    jobs = [make_job(number, "F", world=None, seed=1).model_copy(update={"step": "balance"}) for number in range(20)]
    record = make_night(jobs, runs=tmp_path / "runs", name="old")
    store_night(record)
    service = cast(Service, SimpleNamespace(catalog=Catalog(tmp_path), settings=SimpleNamespace(home=tmp_path)))
    end = EarlyEnd(Against(run_id=record.run_id, alpha=0.05), SPEC, service, lambda _: None, None)
    assert not end.is_decided
    assert end.answer([]).why == "no job has the step, world and seed of one of that run"
