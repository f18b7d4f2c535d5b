"""A server that is stuck says where."""

import subprocess
import sys
from pathlib import Path

STUCK = """
import asyncio, os, time
from prefect_robomaker.deployments.prefect_server import stuck_loop

def where_it_is_stuck():
    end = time.monotonic() + 120
    while not os.fstat(2).st_size and time.monotonic() < end:
        time.sleep(0.05)

async def watched(silent_s, stuck):
    stuck_loop._SILENT_S, stuck_loop._TICK_S = silent_s, 0.05
    told = asyncio.create_task(stuck_loop.tell_when_stuck(None))
    await asyncio.sleep(0.2)
    if stuck:
        where_it_is_stuck()
    told.cancel()
    await asyncio.gather(told, return_exceptions=True)

asyncio.run(watched(60.0, stuck=False))  # a busy machine makes every process silent for a moment
print(os.fstat(2).st_size)
asyncio.run(watched(0.3, stuck=True))
"""


def test_a_server_that_is_stuck_says_where_and_one_that_goes_on_nothing(tmp_path: Path) -> None:
    with (tmp_path / "errors").open("w") as errors:
        command = [sys.executable, "-c", STUCK]
        ended = subprocess.run(command, stdout=subprocess.PIPE, stderr=errors, check=True, timeout=240, text=True)
    assert ended.stdout == "0\n"
    assert "in where_it_is_stuck" in (tmp_path / "errors").read_text()
