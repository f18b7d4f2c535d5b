"""Pages of worlds: the gallery by template or job, and the page of one with plan, checks and 3D view."""

import json
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from starlette.responses import HTMLResponse, Response

from ....schemas.documents.worlds import WorldDocument, WorldGenerationJobDocument, WorldTemplateDocument
from ....schemas.wire.errors import ObjectNotFoundError
from ....tasks.catalog import Resource
from ....tasks.inspection.reports import report_of_world
from ....tasks.reporting import view_report
from ....tasks.service.references import names_of_worlds
from ....tasks.simulations.inputs.bundles import world_bundle
from ....tasks.worldforge.proofs.guarantees import proof_lines, violations
from ....tasks.worlds.previews import preview_of
from ....tasks.worlds.reuse import same_body
from ..job_states import look_of_status
from ..visit import Visit

WORLD = "world"
GENERATION = "world-generation-job"
_PAGE_LENGTH = 24
_MOST_TEMPLATES = 30
_MOST_JOBS = 10
_TEMPLATE = "world-template"
_KEPT = {"cache-control": "private, max-age=86400"}
"""HTTP header that lets browsers cache files of a world for a day, as worlds never change."""

_OPEN_PAGE = {**_KEPT, "content-security-policy": "sandbox allow-scripts; frame-ancestors 'none'"}
"""Headers of pages with their own scripts (3D view): a sandbox of another origin, which cannot access the console."""


def show_all(visit: Visit) -> Response:
    """Web page with the gallery of worlds that the visitor may see, of one template or tag if the address names it."""
    template = visit.parameter("template")
    templates = visit.service.catalog.list(_TEMPLATE, limit=_MOST_TEMPLATES, members=())
    seen = visit.seen(templates.resources)
    repeated = Counter(each.name for each in seen)
    names = {each.id: each.name if repeated[each.name] == 1 else f"{each.name} ({each.id})" for each in seen}
    of_template = {"templateId": [template]} if template else {}
    tag = visit.parameter("tag")
    worlds, next_token = _listed(visit, {**of_template, **({"tag": [tag]} if tag else {})})
    return visit.page(
        "worlds.html.j2",
        worlds=worlds,
        names=_names(worlds, visit),
        next_token=next_token,
        templates=names,
        template=template,
        job=None,
        **_of_template(template, visit),
    )


def _of_template(template: str, visit: Visit) -> dict[str, Any]:
    """Returns the template whose worlds are shown, its body, and its generation jobs, for the page's template."""
    found = visit.service.catalog.get_many([visit.service.arn(_TEMPLATE, template)]) if template else {}
    for made_from in visit.seen(found.values()):
        page = visit.service.catalog.list(GENERATION, filters={"templateId": [template]}, limit=_MOST_JOBS, members=())
        jobs = [(each, look_of_status(GENERATION, each.status)) for each in visit.seen(page.resources)]
        body = WorldTemplateDocument.of(made_from).template_body
        return {"made_from": made_from, "body": _indented(body), "generations": jobs}
    return {"made_from": None}


def _indented(body: str) -> str:
    with suppress(ValueError):
        return json.dumps(json.loads(body), indent=2, ensure_ascii=False)
    return body


def show_of_job(visit: Visit) -> Response:
    """Web page with the gallery of a world generation job.

    Raises ResourceNotFoundException if the visitor may see no such job.
    """
    job = visit.find(GENERATION, visit.request.path_params["id"])
    worlds, next_token = _listed(visit, {"generationJobId": [job.id]})
    return visit.page(
        "worlds.html.j2",
        worlds=worlds,
        names=_names(worlds, visit),
        next_token=next_token,
        templates={},
        template="",
        job=job,
        look=look_of_status(GENERATION, job.status),
        document=WorldGenerationJobDocument.of(job),
    )


def show(visit: Visit) -> Response:
    """Web page of one world: its drawing, proofs, broken guarantees, and the template it was made from.

    Raises ResourceNotFoundException if the visitor may see no such world.
    """
    world = visit.find(WORLD, visit.request.path_params["id"])
    view = view_report(report_of_world(world.arn, visit.service)).worlds[0]
    content = view.content
    return visit.page(
        "world.html.j2",
        world=world,
        view=view,
        proofs=proof_lines(content) if content else [],
        broken=violations(content.checks) if content and content.checks else [],
        is_checked=content is not None and content.checks is not None,
        **_made_from(world, visit),
        job_id=(world.parent or "").rpartition("/")[2] if visit.sees(world.parent) else "",
    )


def _made_from(world: Resource, visit: Visit) -> dict[str, Any]:
    """Returns the template of a world, the name that it had then, and whether it has another body since.

    The name is that of the template now where the world does not record one, and empty if neither is known.
    """
    document = WorldDocument.of(world)
    found = visit.service.catalog.get_many(filter(None, (document.template, world.parent)))
    template, job = found.get(document.template or ""), found.get(world.parent or "")
    changed = (
        template is not None
        and job is not None
        and not same_body(
            WorldTemplateDocument.of(template).template_body, WorldGenerationJobDocument.of(job).template_body
        )
    )
    now = template.name if template is not None else ""
    return {"template": document.template, "template_name": document.template_name or now, "other_body": changed}


def show_in_3d(visit: Visit) -> Response:
    """Web page with a 3D view of a world.

    Raises ResourceNotFoundException if the visitor may see no such world.
    """
    # Imports MuJoCo and what makes meshes, 25 MB that `serve` does not need otherwise.
    from ....tasks.worldforge.viewer.viewer_page import viewer_page

    world = visit.find(WORLD, visit.request.path_params["id"])
    return HTMLResponse(viewer_page(world_bundle(world, visit.service), world.id), headers=_OPEN_PAGE)


def send_preview(visit: Visit) -> Response:
    """Sends the picture of a world from above, a PNG, to the browser.

    Raises ResourceNotFoundException if the visitor may see no such world, ObjectNotFoundError if it cannot be drawn.
    """
    world = visit.find(WORLD, visit.request.path_params["id"])
    picture = preview_of(world, visit.service)
    if not picture:
        raise ObjectNotFoundError(f"{world.id} cannot be drawn")
    return Response(picture, media_type="image/png", headers=_KEPT)


def _names(worlds: Sequence[Resource], visit: Visit) -> dict[str, str]:
    """Returns the names of worlds by ARN; beside each stands its id, which tells worlds of one name apart."""
    return names_of_worlds((world.arn for world in worlds), visit.service)


def _listed(visit: Visit, filters: dict[str, list[str]]) -> tuple[Sequence[Resource], str | None]:
    page = visit.listed(WORLD, filters, _PAGE_LENGTH, ())
    return visit.seen(page.resources), page.next_token


PAGES = {
    "/worlds": show_all,
    "/worlds/{id:path}/view": show_in_3d,
    "/worlds/{id:path}/preview.png": send_preview,
    "/worlds/{id:path}": show,
    "/generations/{id}": show_of_job,
}
