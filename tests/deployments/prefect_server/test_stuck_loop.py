"""A server that is stuck says where."""

import subprocess
import sys
from pathlib import Path

STUCK = """
import asyncio, os, sys, time
from prefect_robomaker.deployments.prefect_server import server_process

server_process._SILENT_S, server_process._TICK_S = float(sys.argv[1]), 0.05

def where_it_is_stuck():
    end = time.monotonic() + 120
    while not os.fstat(2).st_size and time.monotonic() < end:
        time.sleep(0.05)

async def main():
    told = asyncio.create_task(server_process.tell_when_stuck(None))
    await asyncio.sleep(0.2)
    if sys.argv[2] == "stuck":
        where_it_is_stuck()
    told.cancel()
    await asyncio.gather(told, return_exceptions=True)

asyncio.run(main())
"""


def told(folder: Path, silent_s: float, how: str) -> str:
    with (folder / "errors").open("w") as errors:
        command = [sys.executable, "-c", STUCK, str(silent_s), how]
        subprocess.run(command, stderr=errors, check=True, timeout=240)
    return (folder / "errors").read_text()


def test_where_it_is_stuck_is_told(tmp_path: Path) -> None:
    assert "in where_it_is_stuck" in told(tmp_path, 0.3, "stuck")


def test_nothing_is_told_of_one_that_goes_on(tmp_path: Path) -> None:
    # On a busy machine every process is silent for a moment.
    assert told(tmp_path, 60.0, "goes on") == ""
