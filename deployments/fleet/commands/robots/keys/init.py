"""Make the keys of the robots' repository, with root keys that lie elsewhere.

Without it, the first agent that is enrolled makes all keys in the data home, one root key among them.
"""

import argparse
import sys
from pathlib import Path

from .....cli.inputs.options import open_service
from . import add_attested


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker robots keys init` to its parser."""
    parser.add_argument("--root-keys", type=int, default=3, metavar="N", help="how many root keys (default: 3)")
    parser.add_argument(
        "--threshold", type=int, default=2, metavar="M", help="how many of them have to sign a root (default: 2)"
    )
    parser.add_argument("--to", type=Path, required=True, metavar="FOLDER", help="where the root keys go")
    add_attested(parser, "(default: this machine's)")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker robots keys init`: creates the signing keys and first TUF root for updates.

    The root keys are written into the folder of `--to`, whose paths are printed; the other keys stay on this machine.
    """
    from ......tasks.fleet.attestations.envelopes import read_public_key
    from ......tasks.fleet.trust.ceremonies import AttestedChange, begin_apart
    from ......tasks.fleet.trust.publishing import publisher_of

    publisher = publisher_of(open_service())
    change = AttestedChange(tuple(map(read_public_key, arguments.attestation_key)), tuple(arguments.attested))
    begin_apart(publisher, arguments.root_keys, arguments.threshold, arguments.to, change)
    written = sorted(arguments.to.glob("root-*.pem"))
    sys.stdout.write("".join(f"{path}\n" for path in written))
    sys.stderr.write(
        f"{arguments.threshold} of these {arguments.root_keys} root keys sign the next root. Give each to another "
        f"holder, and leave none here. The other keys are in {publisher.machine.folder}.\n"
    )
    return 0
