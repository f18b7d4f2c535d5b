"""Nights that were due and did not happen, as they are kept for each scheduled deployment of a data home."""

from datetime import datetime

from pydantic import Field

from .wire.base import Model, optional


class MissedNight(Model):
    """A run that a schedule had for a time, and that did not happen, or that broke off and is not finished yet."""

    due_at: datetime = Field(description="When it was due, UTC.")
    reason: str = Field(description="Why it did not happen, in words.")
    has_begun: bool = Field(default=False, description="Whether it began, and its process died before its end.")

    @property
    def kind(self) -> str:
        """`no night`, or `not finished`."""
        return "not finished" if self.has_begun else "no night"

    def in_words(self) -> str:
        """`no night on 27 November (02:00 UTC): no Prefect worker was running`."""
        day = f"{self.due_at.day} {self.due_at:%B}"
        return f"no night on {day} ({self.due_at:%H:%M} UTC): {self.reason}"


class NightSchedule(Model):
    """The nights of one deployment whose runs have this data home."""

    deployment: str = Field(description="Id of the deployment in Prefect.")
    name: str = Field(description="Name of the specification.")
    checked_until: datetime = Field(description="Nights that were due until then are judged, UTC.")
    expected: list[datetime] = Field(default=[], description="When the next nights are due, as Prefect said last, UTC.")
    paused_since: datetime | None = optional("When its schedules were first seen paused, UTC; absent: they are not.")
    missed: list[MissedNight] = Field(default=[], description="Nights that did not happen, the oldest first.")
