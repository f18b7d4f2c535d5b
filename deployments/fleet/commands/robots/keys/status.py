"""Show what each role has signed, and when that expires.

Ends with 1 if something is to be done.
"""

import argparse
import sys
from typing import TYPE_CHECKING

from .....cli.arguments import add_output
from .....cli.inputs.options import open_service
from .....cli.output.answers import in_columns, print_either

if TYPE_CHECKING:
    from ......tasks.fleet.trust.metadata import Attested
    from ......tasks.fleet.trust.upkeep import RoleStanding

_COLUMNS = ("role", "version", "expires", "keys")


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker robots keys status` to its parser."""
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker robots keys status`: prints the state of the signing roles; exit code 1 if one has a warning."""
    from ......tasks.fleet.trust.upkeep import attested_of, standing_of

    service = open_service()
    roles, attested = standing_of(service), attested_of(service)
    found = [{**role._asdict(), "expires": role.expires.isoformat()} for role in roles]
    believed = {"keys": sorted(attested.keys), "applications": sorted(attested.applications)}
    print_either(arguments.output, {"schema_version": 1, "roles": found, "attested": believed}, _lines(roles, attested))
    warnings = [role.warning for role in roles if role.warning]
    sys.stderr.write("".join(f"warning: {warning}\n" for warning in warnings))
    return 1 if warnings else 0


def _lines(roles: "list[RoleStanding]", attested: "Attested") -> list[str]:
    if not roles:
        return ["There are no keys yet; `robomaker robots keys init` or the first agent that is enrolled makes them."]
    keys = ", ".join(keyid[:16] for keyid in sorted(attested.keys)) or "no key: agents do not look at them"
    needed = ", ".join(sorted(attested.applications)) or "none"
    table = in_columns([_COLUMNS, *map(_cells, roles)])
    return [*table, f"attestations of {keys}; applications that need one: {needed}"]


def _cells(role: "RoleStanding") -> tuple[str, str, str, str]:
    of = f"{role.threshold} of " if len(role.keyids) > 1 else ""
    keys = ", ".join(keyid[:16] for keyid in role.keyids)
    return role.role, str(role.version), f"{role.expires:%Y-%m-%d %H:%M} UTC", f"{of}{keys}"
