"""The table of a challenge at the end of `robomaker challenge`."""

from collections.abc import Iterator

from ....schemas.reports.challenge import Challenge, SabotageResult
from .answers import Cell


def challenge_lines(challenge: Challenge) -> Iterator[list[Cell]]:
    """Returns the table of a challenge as lines of styled text: each sabotage, then jobs that show nothing."""
    yield [(f"  {challenge.headline}", "bold")]
    width = max(len(each.name) for each in challenge.sabotages)
    if challenge.showing:
        for each in challenge.sabotages:
            yield [(f"  {each.name.ljust(width)}  ", ""), (each.in_words, _style(each))]
    for job in challenge.jobs:
        if job.in_words:
            yield [(f"  {job.in_words}", "yellow")]


def _style(result: SabotageResult) -> str:
    if result.is_only_broken:
        return "yellow"
    if result.caught:
        return "green"
    return "red" if result.is_open else "dim"
