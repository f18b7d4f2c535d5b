"""Shapes of a drawing from any program, and their classification as room, door, window, ..."""

import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple, TypeVar

from pydantic import ValidationError

from ....schemas.specs.yaml_nodes import key_place, parse, plain, value_place
from ....schemas.templates.drawing_notes import DrawingNotes
from ....schemas.wire.base import Model
from ....schemas.wire.errors import ConfigurationError, Problem, SpecError
from ....schemas.wire.request_problems import problems_of
from ....schemas.worlds.world import FurnishedRoomType, Point, bounds, contains

Kind = Literal["room", "door", "opening", "window", "other"]

_KINDS: tuple[tuple[Kind, str], ...] = (
    ("door", "door doors tur turen porte portes puerta puertas porta"),
    ("opening", "opening openings passage passages archway durchgang"),
    ("window", "window windows glaz fenster fenetre fenetres ventana ventanas"),
    ("other", "wall walls wand furniture furn mobel dimension dimensions annotation annotations grid hatch"),
    ("room", "room rooms space spaces raum raume zimmer piece pieces"),
)
"""Words in names and layers of a drawing by the kind of shape they mean (door, window, ...); the first match wins."""

_KIND_WORDS = frozenset(word for _, meaning in _KINDS for word in meaning.split())
_IFC_CONTAINERS = frozenset(["storey", "site", "project"])

_MOST_SORTS = 40
"""Limit of the kinds of ignored shapes that are listed by name; drawings have a dozen layers that are no plan."""

_ROOM_WORDS: tuple[tuple[FurnishedRoomType, tuple[str, ...]], ...] = (
    ("Closet", ("closet", "storage", "wardrobe", "pantry", "dressing", "abstell", "garderobe", "placard", "walkin")),
    ("Bathroom", ("bath", "shower", "toilet", "wc", "ensuite", "powder", "laundry", "bad", "dusche", "salledebain")),
    ("Kitchen", ("kitchen", "kuche", "cuisine", "cocina", "cucina")),
    ("Dining", ("dining", "ess", "comedor", "salleamanger")),
    ("Bedroom", ("bed", "bedroom", "schlaf", "kinder", "nursery", "guest", "chambre", "dormitor", "camera")),
    ("Hallway", ("hall", "corridor", "entr", "foyer", "lobby", "landing", "flur", "diele", "couloir", "pasillo")),
    ("Living", ("living", "lounge", "wohn", "salon", "sala", "sitting", "family", "office", "study", "arbeit", "buro")),
    ("Balcony", ("balcon", "balkon", "loggia", "terrace", "terrasse", "terraza")),
)
"""First letters of words in room names (kitchen, Küche, ...), by the room type they mean."""

_NUMBERED = re.compile(r"(rect|path|polygon|polyline|line|g|layer|shape|lwpolyline|room|space|raum)?[-_]?\d*(-\d+)*")
"""Pattern of names that drawing programs generate themselves, such as `rect12`."""


_SIZE = re.compile(r"\s*\(?\d+([.,]\d+)?\s*(m²|m2|m\^2|qm|sqm|sq\.? ?m)\)?$", re.IGNORECASE)
"""Pattern of an area in a room's name, such as `12 m²`."""


Line = tuple[Point, Point]


MOST_ROOMS = 60


class Shape(NamedTuple):
    """A polygon or line of a drawing, in drawing units, y upwards."""

    points: tuple[Point, ...]
    """Corners of a drawing's shape; of curves, the ends."""
    closed: bool
    curved: bool
    name: str
    """Name of a drawing's shape; empty if it has none."""
    words: tuple[str, ...]
    """Classes, names and layers: the shape's own first, then those of the groups around it."""
    facts: dict[str, str]
    """Further facts about a drawing's shape: `type`, `open`."""
    place: str
    """Name of the shape in error messages: `<rect> "kitchen"`."""
    sort: str = ""
    """Name under which ignored shapes are counted together: `<rect> in "Furniture"`."""
    ways: tuple[Line, ...] = ()
    """Lines that a door with a swing may be closed along, the wall decides which; empty if `points` say it."""
    told: bool | None = True
    """Whether the first of `ways` is likelier than the others; `None`: the line nearest to a wall is taken."""

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Bounding box of a drawing's shape: west, south, east, north."""
        return bounds(self.points)


class Label(NamedTuple):
    """Text in a drawing, with its position."""

    at: Point
    text: str


class Drawing(NamedTuple):
    """All shapes and texts of an imported drawing, and its scale in metres per drawing unit."""

    shapes: list[Shape]
    labels: list[Label]
    metres_per_unit: float | None
    """Metres in the world for one unit of the drawing; `None`: the file does not say."""
    paper_m: float | None = None
    """Metres on paper for one drawing unit, if the file says so; a scale such as 1:50 converts them to the world."""
    left_out: Sequence[str] = ()
    """Descriptions of the drawing's elements that could not be read as shapes."""
    is_exact: bool = True
    """Whether a person drew it, in contrast to a robot's map: only then is a door outside all walls an error."""
    y_up: Literal[1, -1] = 1
    """Direction of the file's own y: 1 is up, as that of the shapes; -1 is down, as in SVG."""


def plain_words(text: str) -> list[str]:
    """Splits a name into lower-case words without accents: `Küche 12 m²` becomes `kuche`, `m`."""
    return re.findall(r"[a-z]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", without_accents(text)).lower())


def without_accents(text: str) -> str:
    """Removes accents from a text: `Küche` becomes `Kuche`."""
    letters = unicodedata.normalize("NFKD", text)
    return "".join(letter for letter in letters if not unicodedata.combining(letter))


def kind_of(shape: Shape, labels: Iterable[Label]) -> Kind | None:
    """Determines what a drawn shape is (room, door, window, ...), by its name; `None` if unknown."""
    for words in shape.words:
        kind, is_type = _meaning(words)
        if kind is not None:
            return kind
        if is_type and shape.closed:
            return "room"
    return "room" if shape.closed and room_type(label_of(shape, labels)) is not None else None


def kind_of_words(words: Iterable[str]) -> Kind | None:
    """Determines the kind of a shape from its classes, names and layers, not from a room's name; `None` if unknown."""
    return next((kind for each in words if (kind := _meaning(each)[0])), None)


@lru_cache(maxsize=4096)
def _meaning(words: str) -> tuple[Kind | None, bool]:
    """Returns the kind of shape that a name means, `None` if unknown, and whether the name is that of a room type."""
    found = set(plain_words(words))
    for kind, meaning in _KINDS:
        if not found.isdisjoint(meaning.split()):
            return kind, False
    # What IFC calls otherwise is a beam or a bed: its own name, such as "Bed", makes it no room.
    if "ifc" in found and not is_ifc_container(words):
        return "other", False
    return None, room_type(words) is not None


def is_ifc_container(words: str) -> bool:
    """Whether a name is that of an IFC project, site, building or storey, such as `IfcBuildingStorey`.

    These contain all other elements. `IfcBuildingElementProxy` is none.
    """
    found = set(plain_words(words))
    return "ifc" in found and (not found.isdisjoint(_IFC_CONTAINERS) or found == {"ifc", "building"})


def is_given(name: str) -> bool:
    """Whether a person gave a shape this name, in contrast to the numbered names of drawing programs."""
    return bool(name) and not _NUMBERED.fullmatch(name.lower())


def names_one(name: str) -> bool:
    """Whether a group's name is that of a single object, such as `Room 7`, and not of a layer, such as `Rooms`."""
    return is_given(name) and not (_KIND_WORDS.issuperset(plain_words(name)) and name.isalpha())


def without_kinds(name: str) -> str:
    """Removes words such as `space` from a name that is made of classes: `Space LivingRoom` becomes `LivingRoom`."""
    return " ".join(word for word in name.split() if word.lower() not in _KIND_WORDS) or name


def label_of(shape: Shape, labels: Iterable[Label]) -> str:
    """Returns a room's label: its own name, else the text drawn inside it; empty if it has neither."""
    if is_given(shape.name):
        return shape.name
    label = label_in(shape, labels)
    return _SIZE.sub("", label.text) if label else ""


def label_in(shape: Shape, labels: Iterable[Label]) -> Label | None:
    """Returns the text inside a closed shape that names it: one that is a type of rooms, else the first, or `None`."""
    inside = [label for label in labels if shape.closed and contains(shape.points, *label.at)]
    return next((label for label in inside if room_type(label.text)), next(iter(inside), None))


def counted(sorts: Mapping[str, int]) -> list[str]:
    """Lists left-out elements in lines such as `3 <circle> in "Furniture"`, up to a readable number of lines."""
    lines = [f"{count} {sort}" for sort, count in sorts.items()]
    rest = sum(list(sorts.values())[_MOST_SORTS:])
    return [*lines[:_MOST_SORTS], f"{rest} of {len(lines) - _MOST_SORTS} more kinds"] if rest else lines


def room_type(name: str) -> FurnishedRoomType | None:
    """Returns the room type that a name means (`kitchen`, `Küche`); `None` if unknown."""
    words = plain_words(name)
    joined = "".join(words)
    for kind, begins in _ROOM_WORDS:
        for begin in begins:
            # Long ones may stand inside: `masterbedroom`; `ess` must not be found in `guesswork`.
            if any(word.startswith(begin) for word in words) or (len(begin) > 4 and begin in joined):
                return kind
    return None


def read_notes(path: Path) -> DrawingNotes:
    """Reads and checks the notes file beside a drawing.

    Raises:
        SpecError: With everything that is wrong: file, line, member, value and what would be right.
        ConfigurationError: The file cannot be read.
    """
    return read_yaml(path, DrawingNotes)


Notes = TypeVar("Notes", bound=Model)


def read_yaml(path: Path, form: type[Notes]) -> Notes:
    """Reads and checks a YAML notes file.

    Args:
        path: The file.
        form: Model of the notes that the file must match.

    Raises:
        SpecError: With everything that is wrong: file, line, member, value and what would be right.
        ConfigurationError: The file cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: it cannot be read: {error}") from error
    root = parse(text, path.name)
    try:
        return form.model_validate(plain(root))
    except ValidationError as error:
        found = [
            Problem((key_place if each.about_key else value_place)(root, each.location), "", str(each))
            for each in problems_of(error, form)
        ]
        raise SpecError(sorted(found, key=lambda each: (each.place.line, each.place.column))) from None
