"""The keys of what agents install: init, status, renew, renew-root, renew-applications."""

import argparse
from pathlib import Path


def add_attested(parser: argparse.ArgumentParser, which: str) -> None:
    """Adds the options for the attestations that agents require to a command's parser.

    Args:
        parser: The command's.
        which: The last words about the keys.
    """
    key = f"a public key whose attestations agents believe {which}"
    parser.add_argument("--attestation-key", type=Path, action="append", default=[], metavar="FILE", help=key)
    attested = "agents install nothing of it that was not attested; '*': of any"
    parser.add_argument("--attested", action="append", default=[], metavar="APPLICATION", help=attested)
