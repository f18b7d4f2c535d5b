"""Checks of `robomaker doctor` about fleets."""

from collections.abc import Callable

from ...schemas.settings import Settings
from ..cli.doctor_checks import Finding


def checks(settings: Settings) -> dict[str, Callable[[], Finding]]:
    """Returns the checks of robot agents for `robomaker doctor`; empty if no agent was enrolled from here."""
    if not (settings.home / "robots" / "trust" / "root.json").exists():
        return {}
    return {"robots' keys": lambda: _check_keys(settings)}


def _check_keys(settings: Settings) -> Finding:
    """Whether what agents trust is signed, and for how long."""
    from ...tasks.fleet.trust.upkeep import standing_of
    from ...tasks.service.service import Service

    with Service.opened(settings) as service:
        roles = standing_of(service)
    warnings = [role.warning for role in roles if role.warning]
    if warnings:
        return Finding("robots' keys", "warning", "\n".join(warnings), "see `robomaker robots keys status`")
    until = min((role.expires for role in roles if role.role == "root"), default=None)
    return Finding("robots' keys", "ok", f"the root is valid until {until:%Y-%m-%d}" if until else "nothing published")
