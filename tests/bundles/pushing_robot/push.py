"""A robot that no seed repeats: it pushes by chance, unless it is told how, and can be made to break."""

import os
import sys
import time

from prefect_robomaker.tasks.runtime.agents.agent_client import connect

mode, factor, break_at = (os.environ.get(name) for name in ("MODE", "FACTOR", "BREAK_AT"))
with connect(mode=mode or "lockstep", real_time_factor=float(factor or 1)) as simulation:
    for step in simulation:
        if step.step >= int(break_at or 1e9):
            print("a wheel came off", file=sys.stderr)
            os._exit(3)
        push = os.environ.get("PUSH")
        simulation.act([float(push) if push else os.urandom(1)[0] / 128 - 1])
        if mode == "free":
            time.sleep(0.005)  # now and then an action is held, or one is never taken
