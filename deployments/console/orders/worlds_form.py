"""Generating worlds: a form for a template and its rooms, or of one that exists, with the plan of the first world."""

import base64
import re
from dataclasses import replace

from starlette.responses import RedirectResponse, Response

from ....schemas.documents.world_templates import WorldTemplateDocument
from ....schemas.operations.registry import parse_request
from ....schemas.operations.world_generation_jobs import too_many_worlds
from ....schemas.templates.parsing import parse_template_body
from ....schemas.wire.errors import InvalidParameterException, ThrottlingException
from ....schemas.worlds.world import FLOOR_MATERIALS, ROOM_TYPES, WALL_MATERIALS
from ...endpoint.calling.scopes import check_scope
from ..rendering import address
from ..visit import Visit
from .previews import NoPlanError, Previews
from .worlds_draft import BY_TYPE, DOORS, MOST_ROOMS, MOST_WAYS, RATIOS, WAYS, WorldsDraft, body_of, draft_of, whole

_TEMPLATE, _GENERATION = "world-template", "world-generation-job"
_PREVIEWS = Previews()


def show(visit: Visit) -> Response:
    """The page, with the plan of what the form begins with."""
    _check(visit, visit.parameter("template"))
    draft = WorldsDraft(template=visit.parameter("template"))
    return _page(visit, _with_plan(visit, draft))


def preview(visit: Visit) -> Response:
    """The plan alone, or what is wrong: for the page that shows it while the form is filled in."""
    draft = draft_of(visit.form)
    _check(visit, draft.template)
    return visit.page("world_plan.html.j2", draft=_with_plan(visit, draft))


def take(visit: Visit) -> Response:
    """Adds or removes a room, draws the plan, or makes template and generation job, as the pressed button says."""
    draft = draft_of(visit.form)
    _check(visit, draft.template)
    does = visit.form.get("do", "")
    change, _, number = does.partition("-")
    if does == "add":
        draft = draft.with_room()
    elif does == "way":
        draft = draft.with_way()
    elif change in ("remove", "unway") and number.isdecimal() and len(number) < 3:
        draft = draft.without_room(int(number)) if change == "remove" else draft.without_way(int(number))
    elif does == "create":
        try:
            return _create(visit, draft)
        except InvalidParameterException as error:
            return _page(visit, replace(draft, problems=_in_words(error)), 400)
    return _page(visit, _with_plan(visit, draft))


def _create(visit: Visit, draft: WorldsDraft) -> Response:
    """Makes the template, if it is new, and orders the worlds."""
    tags = _tags(draft.tags)
    plans, interiors = whole(draft.plans, "floor plans"), whole(draft.interiors, "interiors of each")
    if reason := too_many_worlds(plans, interiors, visit.service.settings.max_worlds_per_job):
        raise InvalidParameterException(reason)  # the operation takes any number, and then the job fails
    counts = {"floorplanCount": plans, "interiorCountPerFloorplan": interiors}
    members = {"worldCount": counts, "seed": whole(draft.seed, "seed"), **({"tags": tags} if tags else {})}
    any_template = visit.service.arn(_TEMPLATE, draft.template or "template-1")
    parse_request("CreateWorldGenerationJob", {**members, "template": any_template})  # before a template is made for it
    if not draft.template:
        made = {"name": draft.name, "templateBody": body_of(draft), **({"tags": tags} if tags else {})}
        any_template = visit.call("CreateWorldTemplate", made)["arn"]
    job = visit.call("CreateWorldGenerationJob", {**members, "template": any_template})
    return RedirectResponse(address(_GENERATION, job["arn"].rpartition("/")[2]), 303)


def _check(visit: Visit, template: str) -> None:
    """Checks that the visitor may do what the form is for.

    Raises:
        AccessDeniedException: the visitor's key is not good for it.
        ResourceNotFoundException: there is no such template that the visitor may see.
    """
    if visit.key is not None:
        check_scope(visit.key, "CreateWorldGenerationJob" if template else "CreateWorldTemplate")
    if template:
        visit.find(_TEMPLATE, template)


def _with_plan(visit: Visit, draft: WorldsDraft) -> WorldsDraft:
    """A draft with its plan, or with what is wrong with it."""
    try:
        if draft.template:
            body = WorldTemplateDocument.of(visit.find(_TEMPLATE, draft.template)).template_body
        else:
            body = body_of(draft)
            parse_template_body(body)
        svg = _PREVIEWS.draw(body, whole(draft.seed, "seed"), visit.key.id if visit.key else visit.address or "")
    except (InvalidParameterException, NoPlanError, ThrottlingException) as error:
        return replace(draft, problems=_in_words(error))
    return replace(draft, plan="data:image/svg+xml;base64," + base64.b64encode(svg.encode()).decode())


def _in_words(error: Exception) -> tuple[str, ...]:
    """Its lines, with fields by the names that the form has for them."""
    text = str(error).replace("templateBody: ", "")
    for place in ("Floorplan", "Interior"):
        text = text.replace(f"Buildings[0].Floors[0].{place}.", "")
    for listed, named in (("Rooms", "Room"), ("DesiredConnections", "Way")):
        text = re.sub(rf"\b{listed}\[(\d+)\]", lambda found, named=named: f"{named} {int(found[1]) + 1}", text)
    return tuple(text.splitlines())


def _page(visit: Visit, draft: WorldsDraft, status: int = 200) -> Response:
    template = visit.find(_TEMPLATE, draft.template) if draft.template else None
    return visit.page(
        "worlds_new.html.j2",
        status=status,
        draft=draft,
        template=template,
        room_types=ROOM_TYPES,
        ratios=list(RATIOS),
        floors=[BY_TYPE, *FLOOR_MATERIALS],
        walls=[BY_TYPE, *WALL_MATERIALS],
        ways=list(WAYS),
        doors=list(DOORS),
        most_rooms=MOST_ROOMS,
        most_ways=MOST_WAYS,
    )


def _tags(text: str) -> dict[str, str]:
    pairs = [each.partition("=") for each in text.replace(",", " ").split()]
    for key, equals, _ in pairs:
        if not equals:
            raise InvalidParameterException(f"tags: there is {key!r}; each has to be written key=value")
    return {key: value for key, _, value in pairs}
