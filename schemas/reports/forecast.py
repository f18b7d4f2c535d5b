"""Forecasts of a run: measurements of a probe (small trial run), forecast values, and their errors."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from ..wire.base import Model


class JobCost(Model):
    """Measured time (s), CPU time and disk space (bytes) of one simulation job in a probe run."""

    slot_s: float = Field(ge=0, description="Wall-clock time for which no other job could have its place.")
    run_s: float = Field(
        ge=0, description="Wall-clock time of the run itself, part of `slot_s`: grows with the number of trials."
    )
    trials: int = Field(ge=1, description="Trials that it ran; 1 without trials.")
    cpu_time_s: float | None = Field(default=None, ge=0, description="CPU time of the job; absent: unknown.")
    size_bytes: int = Field(ge=0, description="Size of the job's outputs.")
    kind: str = Field(default="", description="Kind of job: jobs of one kind probably take as long.")


class StepProbe(Model):
    """Time and disk measurements of one step in a probe, a small trial run of a specification."""

    step: str = Field(description="The step.")
    operation: str = Field(description="The operation it calls.")
    wall_time_s: float = Field(ge=0, description="Wall-clock time of the step in the probe's first pass.")
    first_trials: int = Field(default=1, ge=1, description="Trials of its job in the first pass; 1 without trials.")
    jobs: list[JobCost] = Field(default=[], description="Its simulation jobs, in the last pass.")
    worlds: int = Field(default=0, ge=0, description="Worlds that it made or packed in the first pass.")
    world_s: float = Field(default=0.0, ge=0, description="Wall-clock time of one world in its place.")
    cpu_time_s: float = Field(default=0.0, ge=0, description="CPU time of the processes that made its worlds.")
    size_bytes: int = Field(default=0, ge=0, description="Size of its worlds.")


class Places(Model):
    """Numbers of machines, of concurrent jobs on each, and of processors, that a forecast assumes."""

    machines: int = Field(ge=1, description="Machines that run jobs of batches.")
    jobs_per_machine: int = Field(ge=1, description="Simulation jobs at once on each of them.")
    cpus: int = Field(ge=1, description="Processors of each of them, and of the machine that makes the worlds.")


class StepForecast(Model):
    """Forecast of the time and disk space that one step of the whole run will take."""

    step: str = Field(description="The step.")
    operation: str = Field(description="The operation it calls.")
    parts: int = Field(ge=0, description="Worlds or simulation jobs; 0: it makes none.")
    concurrency: int = Field(ge=1, description="Number of worlds or jobs at the same time.")
    start_s: float = Field(ge=0, description="Wall-clock time that it takes whatever their number: start-up and end.")
    wall_time_s: float = Field(ge=0, description="Wall-clock time.")
    cpu_time_s: float | None = Field(
        default=None, ge=0, description="CPU time of its jobs and worlds; absent: not known."
    )
    size_bytes: int = Field(ge=0, description="Size of their outputs.")
    timeout_s: float | None = Field(
        default=None, gt=0, description="Wall-clock time after which its batch is ended; absent: it is no batch."
    )
    longest_batch_s: float | None = Field(
        default=None,
        ge=0,
        description="Wall-clock time of its longest batch: more than 1,000 jobs are several; absent: it is no batch.",
    )
    over_limit: int = Field(
        default=0, ge=0, description="Jobs that do not finish before their own limit, `maxJobDurationInSeconds`."
    )
    job_s: float | None = Field(default=None, ge=0, description="Time that the slowest of these would need.")
    job_limit_s: float | None = Field(default=None, ge=0, description="The limit of that job.")


class ProbedJob(Model):
    """A simulation job that a probe (a small trial run of a specification) ran, and how it ended."""

    job: str = Field(description="Id of the job.")
    verdict: str = Field(description="Verdict of the job; its status if it has none.")
    reason: str = Field(default="", description="Reason why the job did not pass.")
    trials: int | None = Field(
        default=None, ge=0, description="Number of trials that the job ran; absent: it has no trials."
    )
    trials_passed: int | None = Field(default=None, ge=0, description="Number of trials that passed.")


class Forecast(Model):
    """Forecast of the time, disk space and cost of a run of a specification."""

    schema_version: Literal[1] = Field(default=1, description="Version of this document's form.")
    name: str = Field(description="Name of the specification.")
    made_at: datetime = Field(description="When it was made, UTC.")
    backend: str = Field(description="Backend that runs the jobs of batches.")
    places: Places = Field(description="Places for jobs and worlds that run at once.")
    steps: list[StepForecast] = Field(description="The steps, in the order they run.")
    wall_time_s: float = Field(ge=0, description="Wall-clock time of the run.")
    cpu_time_s: float | None = Field(
        default=None, ge=0, description="CPU time of all jobs and worlds; absent: not known."
    )
    size_bytes: int = Field(ge=0, description="Size of the outputs of all jobs and worlds.")
    price_per_hour: float | None = Field(default=None, ge=0, description="Price of a machine for an hour, as given.")
    cost: float | None = Field(default=None, ge=0, description="Machines x hours x price; absent: no price is given.")
    ran: list[ProbedJob] = Field(default=[], description="The jobs of the probe's last pass, with their verdicts.")
    assumed: list[str] = Field(description="Assumptions behind the figures, in words.")
    probes: list[str] = Field(description="Ids of the runs that were measured.")

    @property
    def cpu_hours(self) -> float | None:
        """Forecast CPU time of the whole run, in hours; `None` if it was not measured."""
        return None if self.cpu_time_s is None else self.cpu_time_s / 3600


class ForecastCheck(Model):
    """A forecast value with the actual value of the run."""

    made_at: datetime = Field(description="When the forecast was made, UTC.")
    forecast_s: float = Field(ge=0, description="Wall-clock time that was forecast.")
    took_s: float = Field(ge=0, description="Wall-clock time that the run took.")

    @property
    def error(self) -> float:
        """Relative error of the forecast: (actual - forecast) / forecast; negative if the run took less than forecast.

        It is 0 for a forecast of 0 s.
        """
        return self.took_s / self.forecast_s - 1 if self.forecast_s > 0 else 0.0

    @property
    def difference(self) -> str:
        """Relative error as text: `8 % more`, `as much`."""
        percent = round(100 * self.error)
        return f"{abs(percent)} % {'more' if percent > 0 else 'less'}" if percent else "as much"
