"""Maintenance windows: times of the week in which robots may be changed."""

from typing import Annotated, Literal
from zoneinfo import ZoneInfo

from pydantic import AfterValidator, Field

from .base import Shape, ShapeName, optional
from .common import text

Weekday = Annotated[
    Literal["MONDAY", "TUESDAY", "WEDNESDAY", "THURSDAY", "FRIDAY", "SATURDAY", "SUNDAY"], ShapeName("Weekday")
]
Weekdays = Annotated[list[Weekday], ShapeName("Weekdays"), Field(min_length=1, max_length=7)]
TimeOfDay = Annotated[str, ShapeName("TimeOfDay"), text(5, 5, "([01][0-9]|2[0-3]):[0-5][0-9]")]
WindowDuration = Annotated[int, ShapeName("WindowDuration"), Field(ge=60, le=24 * 3600)]


def _known_zone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise ValueError(f"{name!r} is no time zone; use a name such as Europe/Berlin or UTC") from None
    return name


TimeZoneName = Annotated[str, ShapeName("TimeZoneName"), text(1, 64), AfterValidator(_known_zone)]


class MaintenanceWindow(Shape):
    """A time of the day, on some days of the week."""

    days: Weekdays | None = optional("Days on which it begins; absent: every day.")
    startTime: TimeOfDay = Field(description="When it begins, as `22:30`, by the clocks of its time zone.")
    durationInSeconds: WindowDuration = Field(
        description="How long it lasts, in seconds, 60 to 86400; it may end on the next day."
    )
    timeZone: TimeZoneName | None = optional("Its time zone, such as `Europe/Berlin`; absent: UTC.")


MaintenanceWindows = Annotated[
    list[MaintenanceWindow], ShapeName("MaintenanceWindows"), Field(min_length=1, max_length=20)
]
