"""When a deployment runs by itself: a cron expression in a time zone."""

from prefect.client.schemas.schedules import CronSchedule
from pydantic import ValidationError

from ...schemas.wire.errors import ConfigurationError


def cron_schedule(cron: str, timezone: str = "UTC") -> CronSchedule:
    """The schedule of a cron expression.

    Args:
        cron: five fields: minute, hour, day of the month, month, day of the week; or `@daily` and the like.
        timezone: an IANA name such as `Europe/Berlin`, whose summer time counts.

    Raises:
        ConfigurationError: one of them is none.
    """
    try:
        return CronSchedule(cron=cron, timezone=timezone)
    except ValidationError as error:
        wrong = {str(problem["loc"][0]) for problem in error.errors() if problem["loc"]}
        if "timezone" in wrong:
            raise ConfigurationError(
                f"--timezone is {timezone!r}; an IANA name such as UTC or Europe/Berlin would be right"
            ) from error
        raise ConfigurationError(
            f"--schedule is {cron!r}; five fields would be right (minute, hour, day of the month, month, day of the "
            "week), such as '0 2 * * *' for every night at two"
        ) from error
