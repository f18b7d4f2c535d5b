"""Reads the shapes and texts of a DXF file: its model space, visible layers, and the content of blocks."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any, NamedTuple

from ....schemas.extras import how_to_install
from ....schemas.wire.errors import ConfigurationError
from ....schemas.worlds.world import Point, bounds
from .door_symbols import Swing, belongs, doorways
from .drawn_shapes import Drawing, Kind, Label, Shape, counted, kind_of_words

if TYPE_CHECKING:
    from ezdxf import document as documents


# ezdxf knows the attributes of entities at run time only.
Entity = Any

_TEXTS = ("TEXT", "MTEXT", "ATTRIB")
_DRAWN = frozenset(["LINE", "LWPOLYLINE", "POLYLINE", "SPLINE", "ARC", "CIRCLE", "ELLIPSE", "SOLID", "TRACE", "3DFACE"])
"""DXF entity types with an outline that is read.

Hatches, pictures and masks have one too, but are drawn beside them as lines.
"""
_BINARY = b"AutoCAD Binary DXF"
_WAYS: tuple[Kind, ...] = ("door", "opening", "window")
_DEEPEST = 8
_MOST_ENTITIES = 100_000


class Part(NamedTuple):
    """An entity of a DXF drawing, or a piece of one."""

    place: str
    sort: str
    words: tuple[str, ...]
    points: list[Point]
    closed: bool
    curved: bool
    swing: Swing | None


def read_dxf(content: bytes, name: str) -> Drawing:
    """Reads the floor plan shapes and texts of a DXF file.

    Args:
        content: The file's bytes.
        name: Name of the file in error messages.

    Raises:
        ConfigurationError: The file is not a DXF drawing, or ezdxf is not installed.
    """
    try:
        from ezdxf import units
        from ezdxf.enums import InsertUnits
        from ezdxf.lldxf.const import DXFError
    except ImportError as error:
        raise ConfigurationError(
            f"{name}: ezdxf, which reads DXF files, is not installed: {how_to_install('dxf')}"
        ) from error
    # The reader takes any bytes, and finds nothing in them.
    if b"SECTION" not in content:
        what = "DWG; the same drawing, saved as DXF, would be right" if content.startswith(b"AC1") else "not DXF"
        raise ConfigurationError(f"{name}: this is {what}")
    if not content.startswith(_BINARY) and not content.rstrip().endswith(b"EOF"):
        raise ConfigurationError(f"{name}: the file is cut off; DXF ends with a line EOF")
    try:
        document = _document(content)
        reader = _Reader(document, name)
        reader.walk(document.modelspace(), (), 0)
    except (DXFError, ValueError, KeyError, IndexError, AttributeError, TypeError) as error:
        raise ConfigurationError(f"{name}: this is DXF that cannot be read: {error}") from error
    # $INSUNITS; 0 says nothing. ezdxf's inch is 0.0254000000001016 m.
    factor = units.conversion_factor(InsertUnits(document.units), InsertUnits.Meters) if document.units else None
    metres = factor and float(f"{factor:.9g}")
    return Drawing(reader.shapes, reader.labels, metres, left_out=counted(reader.unread))


def _document(content: bytes) -> "documents.Drawing":
    from ezdxf import document as documents
    from ezdxf import recover
    from ezdxf.lldxf.tagger import binary_tags_loader

    if content.startswith(_BINARY):
        return documents.Drawing.load(binary_tags_loader(content))
    document, _ = recover.read(BytesIO(content))
    return document


class _Reader:
    """Walks through the entities of a DXF drawing and of its blocks."""

    def __init__(self, document: "documents.Drawing", name: str) -> None:
        self._layers = document.layers
        self._name = name
        self._count = 0
        self.unread: Counter[str] = Counter()
        self.shapes: list[Shape] = []
        self.labels: list[Label] = []

    def walk(self, entities: Iterable[Entity], around: tuple[str, ...], depth: int) -> None:
        """Collects the shapes of DXF entities, also those inside blocks.

        Shapes, texts and counts of what cannot be read are added to this object's own.
        """
        doors: list[Part] = []
        for entity in self._visible(entities):
            words = (entity.dxf.layer, *around)
            if entity.dxftype() in _TEXTS:
                self._text(entity)
            elif entity.dxftype() == "INSERT":
                for each in self._visible(entity.multi_insert()) if entity.mcount > 1 else [entity]:
                    self._block(each, words, depth)
            elif kind_of_words(words) == "door":
                doors += self._parts(entity, words, _place(entity))
            else:
                self.shapes += [_shape(part) for part in self._parts(entity, words, _place(entity))]
        self._doors(doors, one=False)

    def _visible(self, entities: Iterable[Entity]) -> Iterator[Entity]:
        for entity in entities:
            self._count += 1
            if self._count > _MOST_ENTITIES:
                raise ConfigurationError(
                    f"{self._name}: it has more than {_MOST_ENTITIES:,} entities, those in blocks too"
                )
            if not entity.dxf.is_supported("layer"):  # a kind that ezdxf does not know, without the usual members
                self.unread[entity.dxftype()] += 1
                continue
            layer: Entity = self._layers.get(entity.dxf.layer) if entity.dxf.layer in self._layers else None
            if not entity.dxf.invisible and (layer is None or (layer.is_on() and not layer.is_frozen())):
                yield entity

    def _text(self, entity: Entity) -> None:
        lines = entity.plain_text()
        at = entity.dxf.insert
        if entity.dxf.hasattr("halign") and entity.dxf.halign and entity.dxf.hasattr("align_point"):
            at = entity.dxf.align_point
        at = at if entity.dxftype() == "MTEXT" else entity.ocs().to_wcs(at)
        if text := " ".join(lines.split()):
            self.labels.append(Label((at.x, at.y), text))

    def _block(self, insert: Entity, words: tuple[str, ...], depth: int) -> None:
        for text in self._visible(insert.attribs):
            self._text(text)
        if insert.block() is None or depth > _DEEPEST:
            self.unread[f'{insert.dxftype()} of "{insert.dxf.name}"'] += 1
            return
        # Names of blocks say what doors are, but not what rooms are: "room tag" is a name of blocks for texts.
        named = (insert.dxf.name, *words)
        kind = kind_of_words((insert.dxf.name,)) or kind_of_words(words)
        if kind not in _WAYS:
            self.walk(insert.virtual_entities(), words, depth + 1)
            return
        place = f'INSERT {insert.dxf.handle} of "{insert.dxf.name}" on layer "{insert.dxf.layer}"'
        parts = [part for each in self._visible(insert.virtual_entities()) for part in self._parts(each, named, place)]
        if kind == "door":
            self._doors(parts, one=True)
        elif parts:
            self.shapes.append(_box(parts, kind))

    def _doors(self, parts: list[Part], *, one: bool) -> None:
        """Recognises doors drawn with a leaf and its swing, or as a line or shape along the wall.

        Args:
            parts: Lines and arcs of one block or of a layer.
            one: Whether it is one door.
        """
        swings = {part.swing: part for part in parts if part.swing}
        lines = [part for part in parts if not part.swing]
        for door in doorways(list(swings), [line.points for line in lines]):
            drawn = _shape(swings[door.swing]._replace(points=[*door.lines[0]], curved=False), "door")
            self.shapes.append(drawn._replace(ways=door.lines, told=door.told))
        if one and lines and not swings:
            self.shapes.append(_box(lines, "door"))
        elif not one:
            self.shapes += [_shape(line, "door") for line in lines if not belongs(line.points, swings)]

    def _parts(self, entity: Entity, words: tuple[str, ...], place: str) -> list[Part]:
        """Converts a DXF entity to lines and arcs; empty for an entity without an outline.

        An entity without an outline is counted in `unread`.
        """
        from ezdxf.path import make_path

        if entity.dxftype() in ("LWPOLYLINE", "POLYLINE") and entity.has_arc and kind_of_words(words) == "door":
            return [part for each in entity.virtual_entities() for part in self._parts(each, words, place)]
        try:
            path = make_path(entity) if entity.dxftype() in _DRAWN else None
        except TypeError:  # a mesh of polylines
            path = None
        if path is None:
            self.unread[_sort(entity)] += 1
            return []
        points = [(at.x, at.y) for at in (path.start, *(command.end for command in path.commands()))]
        closed = len(points) > 3 and path.is_closed
        swing = None
        if entity.dxftype() == "ARC":
            hinge = entity.ocs().to_wcs(entity.dxf.center)
            swing = Swing((hinge.x, hinge.y), (points[0], points[-1]))
        points = points[:-1] if closed else points
        if len(points) < 2:
            self.unread[_sort(entity)] += 1
            return []
        return [Part(place, _sort(entity), words, points, closed, path.has_curves, swing)]


def _place(entity: Entity) -> str:
    """Returns the name of a DXF entity for error messages, with the handle by which CAD programs find it."""
    return f'{entity.dxftype()} {entity.dxf.handle} on layer "{entity.dxf.layer}"'


def _sort(entity: Entity) -> str:
    return f'{entity.dxftype()} on layer "{entity.dxf.layer}"'


def _shape(part: Part, kind: Kind | None = None) -> Shape:
    """Converts a DXF part to a shape.

    Only doors, openings and windows have names; names of rooms are texts inside them.
    """
    kind = kind or kind_of_words(part.words)
    name = part.place if kind in _WAYS else ""
    words = (kind, *part.words) if kind else part.words
    return Shape(tuple(part.points), part.closed, part.curved, name, words, {}, part.place, part.sort)


def _box(parts: Sequence[Part], kind: Kind) -> Shape:
    """Returns the bounding box of a DXF block as one shape of a kind."""
    west, south, east, north = bounds(point for part in parts for point in part.points)
    corners = [(west, south), (east, south), (east, north), (west, north)]
    return _shape(parts[0]._replace(points=corners, closed=True, curved=False), kind)
