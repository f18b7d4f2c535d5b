"""What a probe says of the whole run."""

import math
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.forecast import Forecast, JobCost, Places, StepForecast, StepProbe
from prefect_robomaker.schemas.specs.probe_requests import BATCH, EXPORT, GENERATION, JOB, JobAmount
from prefect_robomaker.tasks.inspection.forecasting import WholeStep, forecast_run, forecast_step, makespan_s

NOW = datetime(2026, 3, 1, tzinfo=UTC)
DURATIONS = st.floats(min_value=0.0, max_value=1e4)
COSTS = st.builds(
    lambda around, run, trials, cpu, size: JobCost(
        slot_s=around + run, run_s=run, trials=trials, cpu_time_s=cpu, size_bytes=size
    ),
    DURATIONS, DURATIONS, st.integers(1, 50), st.none() | DURATIONS, st.integers(0, 10**9),
)  # fmt: skip
PROBES = st.builds(
    StepProbe,
    step=st.just("drive"),
    operation=st.just(BATCH),
    wall_time_s=DURATIONS,
    jobs=st.lists(COSTS, min_size=1, max_size=4),
)
AMOUNTS = st.lists(st.builds(JobAmount, trials=st.integers(1, 500), limit_s=DURATIONS), min_size=1, max_size=40)
PLACES = st.builds(Places, machines=st.integers(1, 20), jobs_per_machine=st.integers(1, 16), cpus=st.integers(1, 16))
ONE = Places(machines=1, jobs_per_machine=2, cpus=2)


def waits(count: int, seconds: float = 10.0, wall_s: float = 12.0) -> StepProbe:
    """A batch whose jobs mostly wait: it took 12 s, of them 10 s for its job."""
    cost = JobCost(slot_s=seconds, run_s=seconds - 1, trials=1, cpu_time_s=0.5, size_bytes=1000)
    return StepProbe(step="drive", operation=BATCH, wall_time_s=wall_s, jobs=[cost] * count)


def whole(jobs: int, at_once: int = 100, trials: int = 1, limit_s: float = 3600.0) -> WholeStep:
    return WholeStep([JobAmount(trials, limit_s)] * jobs, max_concurrency=at_once)


def run_of(*steps: tuple[StepProbe, WholeStep], places: Places = ONE, price: float | None = None) -> Forecast:
    return forecast_run(
        "night", steps, places, backend="local", made_at=NOW, assumed=[], probes=["night-probe-1"], price_per_hour=price
    )


def took(step: StepForecast) -> float:
    return step.wall_time_s


@examples(50)
@given(PROBES, AMOUNTS, st.integers(1, 64), PLACES)
def test_no_more_time_with_more_machines_and_no_less_with_more_jobs(
    probe: StepProbe, amounts: list[JobAmount], at_once: int, places: Places
) -> None:
    step = WholeStep(amounts, max_concurrency=at_once)
    more_places = places.model_copy(update={"machines": places.machines + 1})
    more_jobs = WholeStep([*amounts, amounts[-1]], max_concurrency=at_once)
    seconds = took(forecast_step(probe, step, places))
    assert took(forecast_step(probe, step, more_places)) <= seconds * (1 + 1e-9)
    assert took(forecast_step(probe, more_jobs, places)) >= seconds * (1 - 1e-9)


@examples(50)
@given(st.lists(DURATIONS, max_size=60), st.integers(1, 20))
def test_jobs_are_never_done_before_work_and_longest_job_allow(durations_s: list[float], places: int) -> None:
    span_s = makespan_s(durations_s, places)
    least_s = max(sum(durations_s) / places, max(durations_s, default=0.0))
    assert least_s * (1 - 1e-9) <= span_s <= sum(durations_s) / places + max(durations_s, default=0.0) + 1e-6


@examples(50)
@given(st.lists(st.tuples(PROBES, st.builds(WholeStep, AMOUNTS)), max_size=3), PLACES, st.floats(0, 1000))
def test_cost_is_machine_hours_times_price(
    steps: list[tuple[StepProbe, WholeStep]], places: Places, price: float
) -> None:
    forecast = run_of(*steps, places=places, price=price)
    assert forecast.cost == pytest.approx(places.machines * forecast.wall_time_s / 3600 * price)
    assert run_of(*steps, places=places).cost is None


def test_jobs_take_turns_after_the_start() -> None:
    """Two of the twelve seconds of the probe are start and end; then there are four rounds of ten seconds."""
    step = forecast_step(waits(1), whole(7, at_once=8), ONE)
    assert (step.parts, step.concurrency, step.start_s, step.wall_time_s) == (7, 2, 2.0, 42.0)
    assert (step.cpu_time_s, step.size_bytes) == (pytest.approx(3.5), 7000)
    machines = ONE.model_copy(update={"machines": 2})
    assert took(forecast_step(waits(1), whole(7, at_once=8), machines)) == 22.0
    assert took(forecast_step(waits(1), whole(7, at_once=1), machines)) == 72.0


def test_a_probe_of_the_whole_step_forecasts_what_it_took() -> None:
    assert took(forecast_step(waits(1), whole(1), ONE)) == 12.0


def test_jobs_that_compute_have_no_more_than_the_processors() -> None:
    cost = JobCost(slot_s=10.0, run_s=10.0, trials=1, cpu_time_s=10.0, size_bytes=0)
    probe = StepProbe(step="drive", operation=BATCH, wall_time_s=10.0, jobs=[cost])
    crowded = Places(machines=1, jobs_per_machine=8, cpus=2)
    assert took(forecast_step(probe, whole(8), crowded)) == 40.0


def test_trials_count_one_by_one_up_to_the_duration_limit() -> None:
    """The second pass ran 40 trials in 20 s and one second around them; the first, of 4 trials, took 8 s."""
    cost = JobCost(slot_s=21.0, run_s=20.0, trials=40, cpu_time_s=10.0, size_bytes=400)
    probe = StepProbe(step="try", operation=JOB, wall_time_s=8.0, first_trials=4, jobs=[cost])
    step = forecast_step(probe, whole(1, trials=1000), ONE)
    assert (step.start_s, step.wall_time_s) == (5.0, 506.0)
    assert (step.cpu_time_s, step.size_bytes) == (pytest.approx(250.0), 10000)
    assert took(forecast_step(probe, whole(1, trials=1000, limit_s=60.0), ONE)) == 66.0


def test_each_kind_of_job_costs_what_those_of_its_kind_did() -> None:
    """A short and a long job ran; a job of a kind that did not costs what these did on average."""
    short = JobCost(slot_s=2.0, run_s=1.0, trials=1, cpu_time_s=0.5, size_bytes=10, kind="short")
    long = JobCost(slot_s=22.0, run_s=21.0, trials=1, cpu_time_s=1.0, size_bytes=1000, kind="long")
    probe = StepProbe(step="drive", operation=BATCH, wall_time_s=3.0, jobs=[short, long])
    jobs = [JobAmount(1, 60.0, kind) for kind in ("short", "short", "short", "long", "short", "other")]

    step = forecast_step(probe, WholeStep(jobs, max_concurrency=1), ONE)

    assert (step.start_s, step.wall_time_s) == (1.0, 1.0 + 4 * 2.0 + 22.0 + 12.0)
    assert (step.cpu_time_s, step.size_bytes) == (pytest.approx(4 * 0.5 + 1.0 + 0.75), 4 * 10 + 1000 + 505)


def test_a_job_outside_a_batch_runs_on_one_machine() -> None:
    many = Places(machines=9, jobs_per_machine=9, cpus=9)
    probe = waits(1).model_copy(update={"operation": JOB})
    assert forecast_step(probe, whole(1), many).concurrency == 1


def test_a_campaign_starts_each_of_its_batches() -> None:
    places = Places(machines=1, jobs_per_machine=1000, cpus=1000)
    assert took(forecast_step(waits(1), whole(2001, at_once=1000), places)) == 3 * 2.0 + 3 * 10.0


def test_worlds_are_made_side_by_side_and_packed_one_after_the_other() -> None:
    """Six worlds on two processors took 8 s, of them three rounds of one second."""
    made = StepProbe(
        step="worlds", operation=GENERATION, wall_time_s=8.0, worlds=6, world_s=1.0, cpu_time_s=9.0, size_bytes=600
    )
    step = forecast_step(made, WholeStep(worlds=51), ONE)
    assert (step.start_s, step.wall_time_s, step.parts, step.concurrency) == (5.0, 31.0, 51, 2)
    assert (step.cpu_time_s, step.size_bytes) == (pytest.approx(76.5), 5100)
    packed = StepProbe(step="export", operation=EXPORT, wall_time_s=3.0, worlds=6, world_s=0.5)
    assert took(forecast_step(packed, WholeStep(worlds=50), ONE)) == 25.0


def test_cpu_time_that_is_not_known_of_one_step_is_not_known_of_the_run() -> None:
    cost = JobCost(slot_s=1.0, run_s=1.0, trials=1, cpu_time_s=None, size_bytes=0)
    unknown = StepProbe(step="other", operation=BATCH, wall_time_s=1.0, jobs=[cost])
    known = run_of((waits(1), whole(2)))
    assert known.cpu_hours == pytest.approx(1 / 3600)
    assert run_of((waits(1), whole(2)), (unknown, whole(2))).cpu_hours is None


def test_steps_without_parts_take_what_they_took() -> None:
    quick = StepProbe(step="template", operation="CreateWorldTemplate", wall_time_s=0.25)
    forecast = run_of((quick, WholeStep()), (waits(1), whole(1)))
    assert forecast.wall_time_s == 12.25
    assert math.isclose(sum(map(took, forecast.steps)), forecast.wall_time_s)


def test_limits_that_come_before_the_end_are_found() -> None:
    probe = waits(1)  # 9 s for a trial
    found = forecast_step(probe, replace(whole(20, at_once=2), timeout_s=60.0), ONE)
    assert (found.timeout_s, found.longest_batch_s, found.over_limit) == (60.0, found.wall_time_s, 0)
    assert found.wall_time_s > 60
    mixed = WholeStep([JobAmount(1, 60.0), JobAmount(4, 30.0), JobAmount(3, 20.0)], max_concurrency=2)
    cut = forecast_step(probe, mixed, ONE)
    assert (cut.over_limit, cut.job_s, cut.job_limit_s) == (2, pytest.approx(36.0), 30.0)
    assert forecast_step(probe, whole(1, limit_s=9.0), ONE).over_limit == 1, "the limit may have cut the probe as well"


def test_each_batch_of_many_jobs_has_the_timeout_for_itself() -> None:
    two = forecast_step(waits(1), replace(whole(2000, at_once=2), timeout_s=1e6), ONE)
    assert two.longest_batch_s == pytest.approx(two.wall_time_s / 2)
