"""Form for ordering worlds: its fields, the template body made from them, and the first world's floor plan."""

import base64
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from starlette.responses import RedirectResponse, Response

from ....schemas.documents.worlds import WorldTemplateDocument
from ....schemas.operations.registry import parse_request
from ....schemas.operations.world_generation_jobs import too_many_worlds
from ....schemas.templates.body import MOST_ROOMS
from ....schemas.templates.parsing import parse_template_body
from ....schemas.wire.errors import InvalidParameterException, ThrottlingException
from ....schemas.worlds.world import FLOOR_MATERIALS, ROOM_TYPES, WALL_MATERIALS
from ....tasks.worldforge.drawings.drawn_shapes import without_accents
from ...endpoint.calling.scopes import check_scope
from ..rendering import address
from ..visit import Visit
from .previews import NoPlanError, Previews

MOST_WAYS = 12
RATIOS = {"1:1": (1, 1), "4:3": (4, 3), "3:2": (3, 2), "2:1": (2, 1)}
BY_TYPE = "by type"
"""Value of the material field that means: as usual for the room's type."""

WAYS = {"doorway": "Doorway", "no wall": "Opening"}
DOORS: Mapping[str, float | str | None] = {"none": None, "open": 100, "half open": 50, "closed": 0, "any": "Random"}
"""Opening of doors in percent, by the name in the form; `None`: doorways without doors."""


@dataclass(frozen=True)
class RoomFields:
    """Form fields of one room in the web console's form for ordering worlds."""

    type: str
    name: str
    area: str
    ratio: str = "4:3"
    floor: str = BY_TYPE
    walls: str = BY_TYPE


@dataclass(frozen=True)
class WayFields:
    """Form fields of a connection between two rooms."""

    first: str
    second: str
    kind: str = "doorway"


_FIRST_ROOMS = (
    RoomFields("Living", "Living room", "26", "3:2"),
    RoomFields("Kitchen", "Kitchen", "14"),
    RoomFields("Bedroom", "Bedroom", "16", "1:1"),
)


@dataclass(frozen=True)
class WorldsDraft:
    """Content of the web console's form for ordering worlds."""

    template: str = ""
    """Id of an existing world template; empty: a new one is made."""

    name: str = "my flat"
    outline: str = "4:3"
    height: str = "2.6"
    plans: str = "2"
    interiors: str = "2"
    seed: str = "7"
    tags: str = ""
    doors: str = "none"
    rooms: tuple[RoomFields, ...] = _FIRST_ROOMS
    ways: tuple[WayFields, ...] = ()
    problems: tuple[str, ...] = ()
    plan: str = ""
    """Floor plan drawing as a data URL; empty: there is none."""

    @property
    def total(self) -> str:
        """Number of worlds that the order form asks for; empty for invalid input."""
        is_known = self.plans.isdecimal() and self.interiors.isdecimal()
        return str(int(self.plans) * int(self.interiors)) if is_known and len(self.plans + self.interiors) < 8 else ""

    def with_room(self) -> "WorldsDraft":
        """Returns the world order form with one more room; without it if the form has as many as are allowed."""
        more = RoomFields("Bathroom", _free_name(self), "10")
        return replace(self, rooms=(*self.rooms, more)[:MOST_ROOMS])

    def without_room(self, index: int) -> "WorldsDraft":
        """Returns the form without a room and its connections; the last room stays."""
        if len(self.rooms) < 2 or not 0 <= index < len(self.rooms):
            return self
        kept = [number for number in range(len(self.rooms)) if number != index]
        now = {str(number): str(place) for place, number in enumerate(kept)}
        ways = (way for way in self.ways if way.first in now and way.second in now)
        moved = tuple(replace(way, first=now[way.first], second=now[way.second]) for way in ways)
        return replace(self, rooms=tuple(self.rooms[number] for number in kept), ways=moved)

    def with_way(self) -> "WorldsDraft":
        """Returns the world order form with one more connection; without it if the form has as many as are allowed."""
        return replace(self, ways=(*self.ways, WayFields("0", str(min(1, len(self.rooms) - 1))))[:MOST_WAYS])

    def without_way(self, index: int) -> "WorldsDraft":
        """Returns the world order form without a connection."""
        return replace(self, ways=tuple(way for number, way in enumerate(self.ways) if number != index))


def body_of(draft: WorldsDraft) -> str:
    """Converts the form to the JSON body of a world template.

    Raises:
        InvalidParameterException: A field holds no number where there has to be one.
    """
    named = draft.rooms
    draft = replace(draft, rooms=tuple(replace(room, name=_plain(room.name, n)) for n, room in enumerate(named, 1)))
    rooms = [
        {
            "Type": room.type,
            "Name": room.name,
            **({} if room.name == given.name else {"OriginalName": given.name}),
            "DesiredShape": {"Area": _number(room.area, f"area of {room.name}"), "AspectRatio": _ratio(room.ratio)},
        }
        for room, given in zip(draft.rooms, named, strict=True)
    ]
    plan = {
        "Footprint": {"DesiredAspectRatio": _ratio(draft.outline)},
        "Ceiling": {"Height": _number(draft.height, "ceiling height")},
        "Rooms": rooms,
        "DesiredConnections": [_connection(way, draft.rooms) for way in draft.ways],
    }
    interior: dict[str, Any] = {
        "Flooring": {"MaterialSets": _materials(draft, "floor")},
        "Walls": {"MaterialSets": _materials(draft, "walls")},
    }
    if draft.doors not in DOORS:
        raise InvalidParameterException(f"doors: is {draft.doors!r}; one of {', '.join(DOORS)} would be right")
    if (opening := DOORS[draft.doors]) is not None:
        door = {"InitialState": {"OpenPosition": {"Percent": opening}}}
        interior["Doorways"] = {"DoorwaySets": [{"Name": "all", "TargetSet": "Target.All", "Door": door}]}
    # The first has no doors, and no names in other letters.
    version = "1" if opening is None and draft.rooms == named else "2"
    return json.dumps({"Version": version, "Buildings": [{"Floors": [{"Floorplan": plan, "Interior": interior}]}]})


def draft_of(form: Mapping[str, str]) -> WorldsDraft:
    """Reads the draft of a template and its worlds from submitted form fields; without rooms it has some to begin with.

    Texts are cut after 300 characters, and rooms and ways after the most that the form takes.
    """
    given = {
        name: form[name][:300]
        for name in ("template", "name", "outline", "height", "doors", "plans", "interiors", "seed", "tags")
        if name in form
    }
    rooms = tuple(RoomFields(**each) for each in _of_list(form, "room", MOST_ROOMS, "type name area ratio floor walls"))
    ways = tuple(WayFields(**each) for each in _of_list(form, "way", MOST_WAYS, "first second kind"))
    return replace(WorldsDraft(rooms=rooms or _FIRST_ROOMS, ways=ways), **given)


def _of_list(form: Mapping[str, str], what: str, most: int, members: str) -> list[dict[str, str]]:
    """Returns the fields of each room or connection in a form; missing members are left out."""
    first, *others = members.split()
    return [
        {first: form[name][:300]}
        | {each: form[field][:300] for each in others if (field := f"{what}-{index}-{each}") in form}
        for index in range(most)
        if (name := f"{what}-{index}-{first}") in form
    ]


def _connection(way: WayFields, rooms: tuple[RoomFields, ...]) -> dict[str, Any]:
    numbers = [whole(each, "rooms of a way") for each in (way.first, way.second)]
    if max(numbers) >= len(rooms):
        raise InvalidParameterException(f"rooms of a way: there is no room {max(numbers) + 1}")
    return {"Location": [rooms[number].name for number in numbers], "ConnectionType": WAYS.get(way.kind, way.kind)}


def _materials(draft: WorldsDraft, what: str) -> list[dict[str, Any]]:
    """Returns a template's material set for each room whose floor or wall material was chosen, not left to its type."""
    chosen = [str(getattr(room, what)) for room in draft.rooms]
    return [
        {
            "Name": f"Room {number}",
            "TargetSet": {"RoomNames": [room.name]},
            "SampleSet": {"MaterialTypes": [material]},
        }
        for number, (room, material) in enumerate(zip(draft.rooms, chosen, strict=True), start=1)
        if material != BY_TYPE
    ]


def _free_name(draft: WorldsDraft) -> str:
    taken = {room.name for room in draft.rooms}
    first = len(taken) + 1
    return next(name for number in range(first, first + 9) if (name := f"Room {number}") not in taken)


def _plain(name: str, number: int) -> str:
    """Converts a room's name to the letters that templates allow.

    One with other signs is unchanged, and refused later.
    """
    bare = without_accents(name)
    plain = re.sub(r"[^a-zA-Z0-9_\- ]", "_", bare)
    if any(one != each and not each.isalpha() for one, each in zip(plain, bare, strict=True)):
        return name
    return plain if plain == bare or re.search("[a-zA-Z0-9]", bare) else f"Room {number}"


def _ratio(text: str) -> dict[str, float]:
    x, y = RATIOS.get(text, (1, 1))
    return {"x": float(x), "y": float(y)}


def _number(text: str, what: str) -> float:
    try:
        return float(text.strip().replace(",", "."))
    except ValueError:
        raise InvalidParameterException(f"{what}: is {text!r}; it has to be a number") from None


def whole(text: str, what: str) -> int:
    """Parses a whole number from a form field.

    Raises:
        InvalidParameterException: The text is not a whole number.
    """
    if not (text.strip().isascii() and text.strip().isdecimal() and len(text) <= 12):
        raise InvalidParameterException(f"{what}: is {text!r}; it has to be a whole number from 0")
    return int(text)


_TEMPLATE, _GENERATION = "world-template", "world-generation-job"
_PREVIEWS = Previews()


def show(visit: Visit) -> Response:
    """Web page with the form for ordering worlds, of the template that the address names or of a new one.

    Raises ResourceNotFoundException if the visitor may not see that template.
    """
    _check(visit, visit.parameter("template"))
    draft = WorldsDraft(template=visit.parameter("template"))
    return _page(visit, _with_plan(visit, draft))


def preview(visit: Visit) -> Response:
    """Returns the floor plan preview, or the errors, while the form is being filled in."""
    draft = draft_of(visit.form)
    _check(visit, draft.template)
    return visit.page("world_plan.html.j2", draft=_with_plan(visit, draft))


def take(visit: Visit) -> Response:
    """Handles the buttons of the worlds form: add or remove rooms and ways, preview the plan, or order the worlds.

    An order that is refused brings the form back with its problems and status 400. Raises ResourceNotFoundException
    if the visitor may not see the chosen template.
    """
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
    """Creates the template of the form if it is new, orders its worlds, and redirects to the generation job's page.

    Raises InvalidParameterException if a field is wrong or too many worlds are asked for; nothing was created then.
    """
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
    """Checks that the visitor may order what the form requests.

    Raises:
        AccessDeniedException: The visitor's key is not good for it.
        ResourceNotFoundException: The visitor may see no such template.
    """
    if visit.key is not None:
        check_scope(visit.key, "CreateWorldGenerationJob" if template else "CreateWorldTemplate")
    if template:
        visit.find(_TEMPLATE, template)


def _with_plan(visit: Visit, draft: WorldsDraft) -> WorldsDraft:
    """Returns a draft with the floor plan of its first world, as a picture in a data URL, or with its problems.

    Raises ResourceNotFoundException if the visitor may not see the chosen template.
    """
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
    """Returns the lines of an error, with the order form's names of the fields."""
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
