"""Child process that draws floor plans of worlds on demand, each within one second of processor time.

Started as `python -m prefect_robomaker.tasks.worldforge.bundle.plan_worker`; reads one JSON object a line from standard
input and answers each with one line on standard output:

    {"body": "<template body>", "seed": 1}
    {"svg": "<svg …>"}   or   {"error": "<why there is no plan>"}

The world is the first one of a generation job with that seed. The process ends when its input does, and when nothing
was asked of it for some time.
"""

import json
import os
import queue
import signal
import sys
import threading
from types import FrameType
from typing import NoReturn, TextIO

from ....schemas.templates.parsing import parse_template_body
from ....schemas.wire.errors import RobomakerError, WorldGenerationError
from ..generator import generate_world
from ..pictures.plan_svg import floorplan_svg
from ..seeds import seeds_for

MOST_CPU_S = 1.0
"""Limit of processor time for one floor plan, in seconds.

A world takes a tenth of that; a plan that takes longer is not drawn.
"""

IDLE_S = 120.0
"""Time without a request after which the process ends, in seconds, so that its memory is free."""


def main() -> None:
    """Draws floor plans in a child process: answers each line of standard input with a line of JSON.

    It ends when no line has come for some time.
    """
    requests, answers = open_channel()
    signal.signal(signal.SIGPROF, _stop)
    while True:
        try:
            line = requests.get(timeout=IDLE_S)
        except queue.Empty:
            return
        print(json.dumps(answer(json.loads(line))), file=answers, flush=True)


def answer(request: dict[str, str | int]) -> dict[str, str]:
    """Draws one floor plan as SVG.

    Returns:
        `{"svg": text}`, or `{"error": reason}` when there is no such world, or none in time.
    """
    signal.setitimer(signal.ITIMER_PROF, MOST_CPU_S)
    try:
        body = parse_template_body(str(request["body"]))
        world = generate_world(body, *seeds_for(int(request["seed"]), 0, 0), settle=False)
        return {"svg": floorplan_svg(world)}
    except RobomakerError as error:
        return {"error": str(error)}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def open_channel() -> tuple["queue.SimpleQueue[str]", TextIO]:
    """Opens the channel to the process that asks: a queue of the lines on standard input, and a stream for answers.

    This process ends when its input does. What libraries print goes to standard error.
    """
    # What a library prints must not come between the answers.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    requests: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(requests,), daemon=True).start()
    return requests, answers


def _read(requests: "queue.SimpleQueue[str]") -> None:
    for line in sys.stdin:
        requests.put(line)
    os._exit(0)


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    del number, frame
    raise WorldGenerationError(
        f"the plan takes more than {MOST_CPU_S:g} s of a processor, and is not shown; worlds may be made all the same"
    )


if __name__ == "__main__":
    main()
