"""Runs that somebody ordered are never too late; that late nights are skipped is tested with overlaps."""

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.execution.late_nights import skipped_night


def test_what_nobody_scheduled_is_never_late(settings: Settings) -> None:
    assert skipped_night(settings) is None
