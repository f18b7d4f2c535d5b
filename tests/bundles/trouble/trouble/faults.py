"""More ways to go wrong than `arena` has."""

import ctypes
import faulthandler
import os
import sys
import time

from .arena import _doing, _say_busy


def _segfault_in_c(environment):
    faulthandler.disable()
    ctypes.string_at(0)


def _fork_without_end(environment):
    for _ in range(10):
        if os.fork() == 0:
            os.setsid()
    time.sleep(1000)


def _stay_in_c(environment):
    _say_busy()
    sum(iter(int, 1))


def _close_stdout(environment):
    sys.stdout.close()
    sys.stderr = None


def _close_descriptors(environment):
    os.close(1)
    os.close(2)


def _fill_the_disk(environment):
    (environment.context.output_dir / "big").write_bytes(bytes(5_000_000))


def _write_too_much(environment):
    for number in range(3):
        (environment.context.output_dir / f"data-{number}.bin").write_bytes(bytes(10_000_000))
    time.sleep(1000)


segfaulting_in_c = _doing(_segfault_in_c)
forking_without_end = _doing(_fork_without_end)
endless_in_c = _doing(_stay_in_c)
closing_stdout = _doing(_close_stdout)
closing_descriptors = _doing(_close_descriptors)
filling_the_disk = _doing(_fill_the_disk)
writing_too_much = _doing(_write_too_much)
