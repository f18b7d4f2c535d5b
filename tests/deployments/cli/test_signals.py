"""Signals that end a command like Ctrl-C."""

import os
import signal

import pytest

from prefect_robomaker.deployments.cli.signals import Terminated, interrupted_by_signals


def test_a_signal_that_comes_twice_at_once_interrupts_once() -> None:
    """`timeout` sends it to the process and to its group; the second one would end the writing of the report."""
    now_s = 100.0
    with interrupted_by_signals(lambda: now_s):
        with pytest.raises(Terminated):
            os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGTERM)
        now_s += 10.0
        with pytest.raises(Terminated):
            os.kill(os.getpid(), signal.SIGTERM)
