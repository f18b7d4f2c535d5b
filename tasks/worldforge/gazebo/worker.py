"""Child process that imports one Gazebo world, with limits of time and memory, as others wrote the files.

Started as `python -P -m prefect_robomaker.tasks.worldforge.gazebo.worker`; reads one JSON object from standard input
and answers with one on standard output:


    {"path": "small.world", "model_paths": [], "start": [0, 0, 0, null], "start_from": null, "loose": "free",
     "allow_missing": false, "notes": "{}", "folder": "/…/bundle"}
    {}   or   {"error": "<why there is no world>"}

It ends when its input does.
"""

import json
import os
import resource
import sys
import threading
from pathlib import Path
from typing import Any

from ....schemas.wire.errors import RobomakerError
from ....schemas.worlds.gazebo_notes import GazeboNotes
from .importing import Start, Wishes, import_gazebo_world

MEMORY_BYTES = 8 * 2**30
"""Limit of address space of the import process, in bytes; the largest public world takes 2 GB."""
CPU_S = 600
"""Limit of processor time of the import process, in seconds; the largest public world took 124 s."""


def main() -> None:
    """Entry point of a child process that imports a Gazebo world.

    It reads one request as a line of JSON from standard input, and writes one answer in JSON to standard output. It
    limits its own memory and CPU time, and ends when its input is closed.
    """
    # What a library prints must not come between the answers.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    line = sys.stdin.readline()
    threading.Thread(target=_end_with_input, daemon=True).start()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S + 5))
    print(json.dumps(answer(json.loads(line))), file=answers, flush=True)


def _end_with_input() -> None:
    sys.stdin.read()
    os._exit(1)


def answer(request: dict[str, Any]) -> dict[str, str]:
    """Imports one Gazebo world on request.

    Args:
        request: The request, a JSON object: `path` of the world file, `folder` for the bundle, and the members of
            `Wishes`.

    Returns:
        `{}`, or `{"error": reason}` if there is no world.
    """
    start = request["start"]
    wishes = Wishes(
        model_paths=[Path(each) for each in request["model_paths"]],
        start=None if start is None else Start(*start),
        start_from=request["start_from"],
        loose=request["loose"],
        allow_missing=request["allow_missing"],
        notes=GazeboNotes.model_validate_json(request["notes"]),
    )
    try:
        import_gazebo_world(Path(request["path"]), wishes, Path(request["folder"]))
    except (RobomakerError, ImportError) as error:
        return {"error": str(error)}
    except MemoryError:
        return {"error": f"{request['path']}: it takes more than {MEMORY_BYTES >> 30} GiB of memory to import"}
    except RecursionError:
        return {"error": f"{request['path']}: its models hang on each other too deeply"}
    except OSError as error:
        return {"error": f"the bundle could not be written: {error}"}
    return {}


if __name__ == "__main__":
    main()
