"""Forecasts that are kept, and what runs say of them."""

from datetime import UTC, datetime, timedelta

import pytest

from prefect_robomaker.schemas.reports.forecast import Forecast, ForecastCheck, Places
from prefect_robomaker.schemas.reports.run_record import StepRecord
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.specification import CheckedSpec
from prefect_robomaker.tasks.inspection.forecasting import check_forecast, find_forecast, keep_forecast

NOW = datetime(2026, 3, 1, tzinfo=UTC)
TEXT = """\
version: 1
name: quick
steps:
  first: {operation: CreateWorldTemplate, input: {name: flat, templateBody: {}}}
"""
DONE = [StepRecord(name="first", operation="CreateWorldTemplate", status="Completed")]


def spec(text: str = TEXT) -> CheckedSpec:
    return load_spec(text, "quick.yaml")


def forecast(wall_time_s: float) -> Forecast:
    return Forecast(
        name="quick", made_at=NOW, backend="local", places=Places(machines=1, jobs_per_machine=2, cpus=2), steps=[],
        wall_time_s=wall_time_s, cpu_time_s=None, size_bytes=0, assumed=[], probes=[],
    )  # fmt: skip


def check(settings: Settings, steps: list[StepRecord] = DONE) -> ForecastCheck | None:
    return check_forecast(spec(), settings, steps, NOW, NOW + timedelta(seconds=108))


def test_a_run_finds_the_newest_forecast_of_what_it_asks_for(settings: Settings) -> None:
    assert check(settings) is None
    keep_forecast(forecast(50.0), spec(), settings)
    keep_forecast(forecast(100.0), spec(f"# another comment\n{TEXT.replace('quick', 'renamed')}"), settings)
    found = check(settings)
    assert found is not None
    assert (found.forecast_s, found.took_s, found.difference) == (100.0, 108.0, "8 % more")
    assert found.error == pytest.approx(0.08)


def test_another_request_or_backend_has_no_forecast(settings: Settings) -> None:
    keep_forecast(forecast(100.0), spec(), settings)
    assert find_forecast(spec(TEXT.replace("flat", "house")), settings) is None
    assert find_forecast(spec(), settings.model_copy(update={"backend": "dask:tcp://head:8786"})) is None


@pytest.mark.parametrize("status", ["Failed", "Canceled", "TimedOut", "PartialFailed", "Skipped"])
def test_a_run_that_did_not_do_all_says_nothing(settings: Settings, status: str) -> None:
    keep_forecast(forecast(100.0), spec(), settings)
    assert check(settings, [*DONE, DONE[0].model_copy(update={"status": status})]) is None


def test_a_forecast_that_cannot_be_read_is_none(settings: Settings) -> None:
    keep_forecast(forecast(100.0), spec(), settings).write_text("{")
    assert find_forecast(spec(), settings) is None


def test_differences_in_words() -> None:
    told = ForecastCheck(made_at=NOW, forecast_s=100.0, took_s=100.2)
    assert told.difference == "as much"
    assert told.model_copy(update={"took_s": 75.0}).difference == "25 % less"
    assert told.model_copy(update={"forecast_s": 0.0}).error == 0.0


@pytest.mark.parametrize("label", ["${{ parameters.label }}", "${{ first.name }} ${{ parameters.label }}"])
def test_a_forecast_is_for_the_values_that_it_was_made_with(settings: Settings, label: str) -> None:
    text = f"""\
version: 1
name: quick
parameters: {{label: {{type: string}}}}
steps:
  first: {{operation: CreateWorldTemplate, input: {{name: flat, templateBody: {{}}}}}}
  second: {{operation: CreateWorldTemplate, input: {{name: "{label}", templateBody: {{}}}}}}
"""
    keep_forecast(forecast(50.0), load_spec(text, "quick.yaml", {"label": "small"}), settings)

    assert find_forecast(load_spec(text, "quick.yaml", {"label": "small"}), settings) is not None
    assert find_forecast(load_spec(text, "quick.yaml", {"label": "large"}), settings) is None
