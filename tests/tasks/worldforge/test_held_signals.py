"""An interruption in the middle of an import that would swallow it still interrupts."""

import signal
import subprocess
import sys
import threading

import pytest

from prefect_robomaker.tasks.worldforge.held_signals import held_signals

_INTERRUPTED = """
import builtins, signal
import scipy, numpy
real = builtins.__import__
def interrupting(name, *more):
    if name.startswith("scipy.") and "trimesh" in str(more[0] and more[0].get("__name__")):
        builtins.__import__ = real
        signal.raise_signal(signal.SIGINT)
    return real(name, *more)
builtins.__import__ = interrupting
try:
    import prefect_robomaker.tasks.worldforge.exports.glb
except KeyboardInterrupt:
    print("interrupted")
else:
    print("went on", builtins.__import__ is real)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_count_when_the_block_has_ended(number: signal.Signals) -> None:
    came: list[str] = []
    before = signal.signal(number, lambda *_: came.append("signal"))
    try:
        with held_signals():
            signal.raise_signal(number)
            came.append("block")
    finally:
        signal.signal(number, before)
    assert came == ["block", "signal"]


def test_other_threads_hold_nothing() -> None:
    came: list[str] = []

    def work() -> None:
        with held_signals():
            came.append("block")

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert came == ["block"]


def test_an_interrupted_import_of_trimesh_does_not_go_on() -> None:
    began = subprocess.run([sys.executable, "-c", _INTERRUPTED], capture_output=True, text=True, timeout=240)
    assert began.stdout == "interrupted\n", began.stderr
