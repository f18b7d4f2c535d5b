"""When a deployment runs by itself: a cron expression in a time zone."""

import asyncio

from prefect.client.schemas.schedules import CronSchedule
from pydantic import ValidationError

from ...schemas.wire.errors import ConfigurationError

_FIELDS = 5


def cron_schedule(cron: str, timezone: str = "UTC") -> CronSchedule:
    """The schedule of a cron expression.

    Args:
        cron: five fields: minute, hour, day of the month, month, day of the week; or `@daily` and the like.
        timezone: an IANA name such as `Europe/Berlin`, whose summer time counts.

    Raises:
        ConfigurationError: one of them is none.
    """
    try:
        schedule = CronSchedule(cron=cron, timezone=timezone)
    except ValidationError as error:
        wrong = {str(problem["loc"][0]) for problem in error.errors() if problem["loc"]}
        if "timezone" in wrong:
            raise ConfigurationError(
                f"--timezone is {timezone!r}; an IANA name such as UTC or Europe/Berlin would be right"
            ) from error
        if len(cron.split()) == _FIELDS:
            raise ConfigurationError(
                f"--schedule is {cron!r}; one of its fields is out of range: minute 0-59, hour 0-23, day of the month "
                "1-31, month 1-12, day of the week 0-7"
            ) from error
        raise ConfigurationError(
            f"--schedule is {cron!r}; five fields would be right (minute, hour, day of the month, month, day of the "
            "week), such as '0 2 * * *' for every night at two"
        ) from error
    if not _comes_due(cron, timezone):
        raise ConfigurationError(f"--schedule is {cron!r}, which never comes: no month that it names has such a day")
    return schedule


def _comes_due(cron: str, timezone: str) -> bool:
    """Whether there is a next time, as Prefect's server will look for it; it finds those of the next decades."""
    from prefect.server.schemas.schedules import CronSchedule as ServersSchedule

    try:
        return bool(asyncio.run(ServersSchedule(cron=cron, timezone=timezone).get_dates(1)))
    except ValueError:  # croniter's for a date that there is not
        return False
