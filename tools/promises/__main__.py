"""Compares the program with the record of its promises, or records them."""

import argparse
import sys
from importlib.metadata import version

from .home import record_home
from .records import HINT, broken_promises, record, unrecorded


def main(words: list[str]) -> int:
    """Runs the command.

    Returns:
        0, or 1 where promises are broken, or are not recorded.
    """
    parser = argparse.ArgumentParser(prog="python -m tools.promises", description=__doc__)
    parser.add_argument("--record", action="store_true", help="write the record anew; from 1.0.0 on only additions")
    parser.add_argument("--record-home", action="store_true", help="run a specification and record its home (a minute)")
    options = parser.parse_args(words)
    broken = list(broken_promises())
    if broken and not (options.record and may_break(version("prefect-robomaker"))):
        sys.stderr.write("".join(f"{problem}\n" for problem in broken))
        return 1
    if options.record:
        record()
    elif new := list(unrecorded()):
        sys.stdout.write("".join(f"{name}\n" for name in new) + f"These are not recorded yet: {HINT}.\n")
        return 1
    if options.record_home:
        record_home()
    return 0


def may_break(release: str) -> bool:
    """Whether the record of a release is still that of "1.0.0 to be", so that promises may change."""
    return int(release.partition(".")[0]) == 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
