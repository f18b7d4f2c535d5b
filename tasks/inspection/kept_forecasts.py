"""Forecasts that are kept in the data home, one for each content of a specification and backend: the newest."""

import hashlib
import json
import logging
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from pydantic import ValidationError

from ...schemas.reports.forecast import Forecast, ForecastCheck
from ...schemas.reports.run_record import StepRecord
from ...schemas.reports.run_states import is_bad
from ...schemas.settings import Settings
from ...schemas.specs.model import CheckedSpec
from ...schemas.specs.text import plain

_FOLDER = "forecasts"
_logger = logging.getLogger(__name__)


def keep_forecast(forecast: Forecast, spec: CheckedSpec, settings: Settings) -> Path:
    """Keeps a forecast for the next runs of the specification, in the place of an earlier one.

    Raises:
        OSError: it cannot be written.
    """
    path = _place(spec, settings)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(forecast.model_dump_json(indent=2, exclude_none=True))
    part.replace(path)
    return path


def find_forecast(spec: CheckedSpec, settings: Settings) -> Forecast | None:
    """The forecast for a specification; `None`: there is none that can be read."""
    path = _place(spec, settings)
    try:
        return Forecast.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValidationError) as problem:
        _logger.warning("the forecast %s cannot be read: %s", path, problem)
        return None


def check_forecast(
    spec: CheckedSpec, settings: Settings, steps: Sequence[StepRecord], started_at: datetime, ended_at: datetime
) -> ForecastCheck | None:
    """How a run compares to its forecast; `None`: there is none, or not all of the run's steps came to a good end."""
    if any(is_bad(step.status) or step.status == "Skipped" for step in steps):
        return None
    forecast = find_forecast(spec, settings)
    if forecast is None:
        return None
    took_s = (ended_at - started_at).total_seconds()
    return ForecastCheck(made_at=forecast.made_at, forecast_s=forecast.wall_time_s, took_s=took_s)


def _place(spec: CheckedSpec, settings: Settings) -> Path:
    """Returns the path of the forecast; names and comments of the specification do not matter."""
    steps = {name: [step.operation, plain(step.input), list(step.needs)] for name, step in spec.steps.items()}
    canonical = json.dumps([settings.backend, steps], sort_keys=True, default=str)
    return settings.home / _FOLDER / f"{hashlib.sha256(canonical.encode()).hexdigest()[:32]}.json"
