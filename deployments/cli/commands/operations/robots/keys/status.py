"""Show what each role has signed, and when that expires.

Ends with 1 if something is to be done.
"""

import argparse
import json
import os
import sys
from typing import TYPE_CHECKING

from .....arguments import add_output

if TYPE_CHECKING:
    from .......tasks.fleet.trust.roots import Attested
    from .......tasks.fleet.trust.standing import RoleStanding

_COLUMNS = ("role", "version", "expires", "keys")


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Prints how the roles stand."""
    from .......schemas.settings import Settings
    from .......tasks.fleet.trust.standing import attested_of, standing_of
    from .......tasks.service.service import Service

    service = Service.open(Settings.from_environment(os.environ))
    roles, attested = standing_of(service), attested_of(service)
    if arguments.output == "json":
        found = [{**role._asdict(), "expires": role.expires.isoformat()} for role in roles]
        believed = {"keys": sorted(attested.keys), "applications": sorted(attested.applications)}
        sys.stdout.write(json.dumps({"schema_version": 1, "roles": found, "attested": believed}, indent=2) + "\n")
    else:
        sys.stdout.write(_table(roles) + (_believed(attested) if roles else ""))
    warnings = [role.warning for role in roles if role.warning]
    sys.stderr.write("".join(f"warning: {warning}\n" for warning in warnings))
    return 1 if warnings else 0


def _table(roles: "list[RoleStanding]") -> str:
    if not roles:
        return "There are no keys yet; `robomaker robots keys init` or the first agent that is enrolled makes them.\n"
    lines = [_COLUMNS, *(_cells(role) for role in roles)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(_COLUMNS))]
    return "".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() + "\n" for line in lines
    )


def _believed(attested: "Attested") -> str:
    keys = ", ".join(keyid[:16] for keyid in sorted(attested.keys)) or "no key: agents do not look at them"
    needed = ", ".join(sorted(attested.applications)) or "none"
    return f"attestations of {keys}; applications that need one: {needed}\n"


def _cells(role: "RoleStanding") -> tuple[str, str, str, str]:
    of = f"{role.threshold} of " if len(role.keyids) > 1 else ""
    keys = ", ".join(keyid[:16] for keyid in role.keyids)
    return role.role, str(role.version), f"{role.expires:%Y-%m-%d %H:%M} UTC", f"{of}{keys}"
