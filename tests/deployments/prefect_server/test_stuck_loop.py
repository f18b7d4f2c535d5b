"""A server that is stuck says where."""

import subprocess
import sys

STUCK = """
import asyncio, time
from prefect_robomaker.deployments.prefect_server import stuck_loop

stuck_loop._SILENT_S, stuck_loop._TICK_S = 0.3, 0.05

def where_it_is_stuck():
    time.sleep({seconds})

async def main():
    told = asyncio.create_task(stuck_loop.tell_when_stuck(None))
    await asyncio.sleep(0.1)
    where_it_is_stuck()
    told.cancel()
    await asyncio.gather(told, return_exceptions=True)

asyncio.run(main())
"""


def told(seconds: float) -> str:
    command = [sys.executable, "-c", STUCK.format(seconds=seconds)]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stderr


def test_where_it_is_stuck_is_told() -> None:
    assert "in where_it_is_stuck" in told(1.0)


def test_nothing_is_told_of_one_that_goes_on() -> None:
    assert told(0) == ""
