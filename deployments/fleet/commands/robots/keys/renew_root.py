"""Sign a new root, alone or one holder after the other; robots follow from root to root.

A root says whose signatures count, and is valid for a year. With `--rotate`, roles get new keys. It also names the keys
whose attestations agents believe, and the applications that need one. Signatures gather in the data home until there
are enough; then the root is published.
"""

import argparse
import sys
from pathlib import Path

from .....cli.inputs.options import open_service
from . import add_attested

_ROLES = ("root", "targets", "snapshot", "timestamp")


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker robots keys renew-root` to its parser."""
    parser.add_argument(
        "--key", type=Path, action="append", default=[], metavar="FILE", help="a root key, from where it is kept"
    )
    parser.add_argument(
        "--rotate", action="append", default=[], choices=_ROLES, metavar="ROLE", help=f"one of {', '.join(_ROLES)}"
    )
    parser.add_argument("--to", type=Path, metavar="FOLDER", help="where new root keys go (default: the data home)")
    add_attested(parser, "from now on, in place of those before")
    parser.add_argument(
        "--not-attested", action="append", default=[], metavar="APPLICATION", help="takes back --attested"
    )


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker robots keys renew-root`: signs the next TUF root, and publishes it once signed enough.

    Prints how many signatures are missing, and the paths of new root keys. Raises ConfigurationError if `--to` is
    given without `--rotate root`.
    """
    from ......schemas.wire.errors import ConfigurationError
    from ......tasks.fleet.attestations.envelopes import read_public_key
    from ......tasks.fleet.trust.ceremonies import AttestedChange, renew_root
    from ......tasks.fleet.trust.publishing import publisher_of

    if arguments.to is not None and "root" not in arguments.rotate:
        raise ConfigurationError("--to is for new root keys; add --rotate root")
    publisher = publisher_of(open_service())
    keys = tuple(map(read_public_key, arguments.attestation_key))
    change = AttestedChange(keys, tuple(arguments.attested), tuple(arguments.not_attested))
    done = renew_root(publisher, tuple(dict.fromkeys(arguments.rotate)), arguments.key, arguments.to, change)
    if done.missing:
        sys.stdout.write(
            f"Root {done.version} needs {done.missing} more signature{'s' if done.missing > 1 else ''}: the next "
            "holder runs `robomaker robots keys renew-root --key FILE` here.\n"
        )
    else:
        sys.stdout.write(f"Root {done.version} is published, valid until {done.expires:%Y-%m-%d}.\n")
    sys.stdout.write("".join(f"new root key: {path}\n" for path in done.new_keys))
    return 0
