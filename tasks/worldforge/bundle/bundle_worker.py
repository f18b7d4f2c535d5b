"""A process that builds world bundles on demand.

Started as `python -m prefect_robomaker.tasks.worldforge.bundle.bundle_worker`; reads one JSON object a line from
standard input and answers each with one line on standard output:

    {"body": "<template body>", "floorplan_seed": 1, "interior_seed": 2, "folder": "/…/bundle"}
    {"content": "<hash>"}   or   {"error": "<why there is no world>"}

It ends when its input does, also in the midst of a world, so it never outlives the process that started it.
"""

import json
import traceback
from pathlib import Path

from ....schemas.templates.parsing import parse_template_body
from ....schemas.wire.errors import RobomakerError
from ..generator import generate_world
from .bundle import write_bundle
from .plan_worker import open_channel


def main() -> None:
    """Writes world files in a child process: answers each line of standard input with a line of JSON.

    The process ends with its standard input.
    """
    requests, answers = open_channel()
    while True:
        print(json.dumps(answer(json.loads(requests.get()))), file=answers, flush=True)


def answer(request: dict[str, str | int]) -> dict[str, str]:
    """Generates one world, writes its files, and returns their hash.

    Returns:
        `{"content": hash}`, or `{"error": reason}` if there is no such world or its files could not be written.
    """
    try:
        body = parse_template_body(str(request["body"]))
        world = generate_world(body, int(request["floorplan_seed"]), int(request["interior_seed"]))
        return {"content": write_bundle(world, Path(str(request["folder"])))}
    except RobomakerError as error:
        return {"error": str(error)}
    except OSError as error:
        return {"error": f"the bundle could not be written: {error}"}
    except Exception as error:
        # One world's failure, told as such: ending here would tell its caller nothing but an exit code.
        traceback.print_exc()
        return {"error": f"the generator failed with {type(error).__name__}: {error}"}


if __name__ == "__main__":
    main()
