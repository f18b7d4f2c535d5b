"""Show all worlds of a generation job at a glance.

As a picture, sheet.png, and as a page, sheet.html; worlds with problems come first, then those of one plan together.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ......schemas.documents.worlds import WorldDocument, WorldFailures, WorldGenerationJobDocument
from ......schemas.wire.arns import ResourceArn
from ......schemas.wire.errors import StorageError
from ....arguments import add_open, add_output
from ....inputs.options import open_service
from ....output import answers

if TYPE_CHECKING:
    from ......tasks.catalog import Resource
    from ......tasks.service.service import Service
    from ......tasks.worldforge.viewer.contact_sheet import Sheet, SheetWorld


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker world sheet` to its parser."""
    parser.add_argument("job", metavar="JOB", help="world generation job: id or its beginning, or ARN")
    parser.add_argument("--to", metavar="FOLDER", help="put both there (default: a folder in the data home)")
    add_output(parser, "text", "json")
    add_open(parser, "show the page in a browser (by default only on a desktop's terminal)")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker world sheet`: writes an overview of a job's worlds as a picture (PNG) and a page (HTML).

    Prints the paths of both, and opens the page in a browser if that is wanted. Raises an error if there is no such
    job.
    """
    from ....inputs.world_lookup import output_file

    if arguments.job.startswith("arn:"):
        ResourceArn.parse(arguments.job, "world-generation-job")  # before a service is opened
    from ......tasks.files.whole_files import write_whole
    from ......tasks.service.references import find_by_id
    from ......tasks.worldforge.viewer.contact_sheet import sheet_page, sheet_png

    service = open_service()
    job = find_by_id(arguments.job, ("world-generation-job",), service)
    sheet = job_sheet(job, service)
    folder = Path(arguments.to) if arguments.to else output_file(job.id, "sheets", "")
    folder.mkdir(parents=True, exist_ok=True)
    html = write_whole(folder / "sheet.html", sheet_page(sheet))
    png = folder / "sheet.png"
    png.write_bytes(sheet_png(sheet))
    _print(sheet, job, {"png": str(png), "html": str(html)}, arguments.output)
    if answers.opens_files(arguments.open):
        answers.open_file(html)
    return 0


def job_sheet(job: "Resource", service: "Service") -> "Sheet":
    """Makes the contact sheet (overview page) of a generation job's worlds so far, those with problems first."""
    from ......tasks.service.references import names_of_worlds
    from ......tasks.worldforge.viewer.contact_sheet import Sheet, SheetFailure, problems_first

    worlds = sorted(
        service.catalog.children(job.arn, kind="world"), key=lambda world: int(world.arn.rpartition("-")[2])
    )
    names = names_of_worlds((world.arn for world in worlds), service)
    shown = [_sheet_world(world, names[world.arn], service) for world in worlds]
    failures = (WorldGenerationJobDocument.of(job).failures or WorldFailures()).failures
    return Sheet(
        title=f"Worlds of {_template_name(job, worlds, service) or job.id}",
        lines=_lines(job, shown),
        worlds=problems_first(shown),
        failures=tuple(
            SheetFailure(each.failure_count, each.failure_code, each.sample_failure_reason) for each in failures
        ),
    )


def _template_name(job: "Resource", worlds: "Sequence[Resource]", service: "Service") -> str:
    """Returns the name that the job's template had when it made worlds, else the one it has; empty: it has none."""
    told = (WorldDocument.of(world).template_name for world in worlds)
    if then := next(filter(None, told), None):
        return then
    template = WorldGenerationJobDocument.of(job).request.template
    now = service.catalog.get_many([template]).get(template)
    return (now.name if now is not None else None) or ""


def _lines(job: "Resource", shown: "list[SheetWorld]") -> tuple[str, ...]:
    from ......schemas.wire.common import counted
    from ......tasks.worldforge.viewer.contact_sheet import plan_numbers

    document = WorldGenerationJobDocument.of(job)
    requested = document.request.world_count.total
    verdicts = Counter(world.verdict for world in shown)
    told = [f"{verdicts['holds']} with all guarantees"]
    told += [f"{verdicts[key]} {words}" for key, words in _TROUBLES if verdicts[key]]
    deleted = len(set(document.succeeded_worlds or []) - {world.arn for world in shown})
    told += [f"{deleted} deleted since"] if deleted else []
    plans = len(plan_numbers(shown))
    return (
        f"{job.id}: {job.status}, {len(shown)} of {counted(requested, 'world')}: {', '.join(told)}",
        f"{plans} different {'plan' if plans == 1 else 'plans'}",
        f"seed {document.seed}, made {job.created_at:%Y-%m-%d %H:%M} UTC",
    )


_TROUBLES = (("broken", "with broken guarantees"), ("not checked", "never checked"), ("gone", "cannot be read"))


def _sheet_world(resource: "Resource", name: str, service: "Service") -> "SheetWorld":
    from ......schemas.worlds.world import WORLD_FILE, World
    from ......tasks.worldforge.pictures.preview import render_preview
    from ......tasks.worldforge.viewer.contact_sheet import SheetWorld, sheet_world

    bundle = WorldDocument.of(resource).bundle
    try:
        if bundle is None:
            raise StorageError(f"{resource.arn} has no stored bundle")
        world = World.model_validate_json(service.store.get_bytes(bundle.bucket, f"{bundle.prefix}/{WORLD_FILE}"))
    except (StorageError, ValueError) as error:
        return SheetWorld(name=name, arn=resource.arn, verdict="gone", problems=(str(error).splitlines()[0],))
    preview = b""
    with suppress(ValueError):  # of a form that cannot be drawn
        preview = render_preview(world, named=False)  # the stored picture's labels would be 5 pixels high
    return sheet_world(name, resource.arn, world, preview)


def _print(sheet: "Sheet", job: "Resource", files: dict[str, str], form: str) -> None:
    if form == "text":
        failures = [f"{each.count} not made: {each.code}: {each.reason}" for each in sheet.failures]
        sys.stdout.write("\n".join([sheet.title, *sheet.lines, *failures, *files.values()]) + "\n")
        return
    from ......tasks.worldforge.viewer.contact_sheet import plan_numbers

    numbers = plan_numbers(sheet.worlds)
    worlds: list[dict[str, Any]] = [
        {
            "name": each.arn.rpartition("/")[2],
            "title": each.name,
            "arn": each.arn,
            "verdict": each.verdict,
            "plan": numbers.get(each.plan),
            "problems": list(each.problems),
        }
        for each in sheet.worlds
    ]
    answer = {"schema_version": 1, "job": job.arn, "status": job.status, **files, "plans": len(numbers)}
    answer["worlds"] = worlds
    sys.stdout.write(json.dumps(answer, indent=2, ensure_ascii=False) + "\n")
