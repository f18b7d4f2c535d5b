"""Answers as text."""

import os
from contextlib import suppress
from io import StringIO

import pytest

from prefect_robomaker.deployments.cli.output.answers import print_lines


def test_lines_stay_in_one_piece_without_styles_where_there_is_no_terminal() -> None:
    stream = StringIO()
    print_lines([[("PASS", "green"), (f" {'x' * 300}", "")], [], [("end", "bold")]], stream)
    assert stream.getvalue() == f"PASS {'x' * 300}\n\nend\n"


def test_a_reader_that_has_gone_away_is_told_to_the_caller() -> None:
    """A console of rich would end the process with 1 instead, which is the exit code of a failed verdict."""
    reading, writing = os.pipe()
    os.close(reading)
    stream = os.fdopen(writing, "w", buffering=1)
    with pytest.raises(BrokenPipeError):
        print_lines([[("PASS", "green")]], stream)
    with suppress(BrokenPipeError):
        stream.close()
