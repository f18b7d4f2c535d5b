"""Checks of `robomaker doctor` for fleets."""

from collections.abc import Callable

from ...schemas.settings import Settings
from ..cli.doctor_checks import Finding

_PAGE = 500
_SHOWN = 10
"""Limit of the robots with problems that `robomaker doctor` names."""


def checks(settings: Settings) -> dict[str, Callable[[], Finding]]:
    """Returns the checks of robot agents for `robomaker doctor`; empty if no agent was enrolled from here."""
    if not (settings.home / "robots" / "trust" / "root.json").exists():
        return {}
    return {"robots' keys": lambda: _check_keys(settings), "robots": lambda: _check_robots(settings)}


def _check_robots(settings: Settings) -> Finding:
    """Checks whether robots report that their applications keep restarting, which no deployment shows as a failure."""
    from ...schemas.fleet.documents import RobotDocument
    from ...tasks.fleet.fleet_records import ROBOT
    from ...tasks.service.service import Service

    count, told, after = 0, list[str](), None
    with Service.opened(settings) as service:
        while True:
            page = service.catalog.list(ROBOT, limit=_PAGE, after=after)
            count += len(page.resources)
            found = ((robot.name, RobotDocument.of(robot).trouble) for robot in page.resources)
            told += [f"{name}: {trouble}" for name, trouble in found if trouble]
            if (after := page.next_token) is None:
                break
    if told:
        more = [f"and {len(told) - _SHOWN} more"] if len(told) > _SHOWN else []
        return Finding("robots", "warning", "\n".join([*told[:_SHOWN], *more]), "deploy a version that runs")
    return Finding("robots", "ok", f"none of {count} says that its application keeps restarting")


def _check_keys(settings: Settings) -> Finding:
    """Checks whether the metadata that agents trust is signed, and for how long."""
    from ...tasks.fleet.trust.upkeep import standing_of
    from ...tasks.service.service import Service

    with Service.opened(settings) as service:
        roles = standing_of(service)
    warnings = [role.warning for role in roles if role.warning]
    if warnings:
        return Finding("robots' keys", "warning", "\n".join(warnings), "see `robomaker robots keys status`")
    until = min((role.expires for role in roles if role.role == "root"), default=None)
    return Finding("robots' keys", "ok", f"the root is valid until {until:%Y-%m-%d}" if until else "nothing published")
