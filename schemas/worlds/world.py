"""A generated world: the content of `world.json` in a world bundle.

A world bundle is a folder:

| file | content |
| --- | --- |
| `world.json` | this module's `World` |
| `world.xml` | MJCF |
| `textures/*.png` | the floors' and walls' pictures, which the MJCF names |
| `meshes/*.obj` | shapes with places on these pictures, which it names; not in worlds that need none |
| `map.pgm`, `map.yaml` | occupancy grid for Nav2's map server |
| `world_description.json` | what the world holds, for other programs |
| `floorplan.svg` | labelled plan |
| `preview.png` | the furnished world from above |

Lengths are metres, angles radians, areas square metres; x points east, y north, z up; the floor's
surface is z = 0 and the origin lies in free space. Furniture stands at `(x, y)` (the middle of its
footprint) with its front turned to `yaw`: at yaw 0 the front faces +x, `depth_m` is measured along
the facing direction and `width_m` across it.
"""

from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from ..wire.base import Model, optional

WORLD_FILE = "world.json"
PREVIEW_FILE = "preview.png"
"""Name of the picture from above: in bundles once the world has been viewed, and in exports."""

PassageKind = Literal["Doorway", "Opening"]


class RoomWay(Model):
    """A connection between two rooms, an edge of the world's room graph."""

    rooms: tuple[str, str] = Field(description="The two rooms it joins.")
    kind: PassageKind = Field(description="Doorway: a gap in a wall; Opening: the wall is gone.")
    clear_width_m: float = Field(
        description="Metres between the walls at its sides, measured; less what a fully open door's leaf takes."
    )
    door: str | None = optional("Id of its door; absent where there is none.")


class RoomMeasures(Model):
    """Measurements of one room: how close it is to its preferred size and shape, and the floor area a robot can use."""

    name: str = Field(description="The room's name.")
    area_error: float = Field(description="(floor area - desired area) / desired area; 0.05 is 5 % too large.")
    aspect_ratio: float = Field(description="Length over width of the floor, at least 1.")
    aspect_error: float = Field(description="(aspect ratio - desired one) / desired one; 0.05 is 5 % too long.")
    fitting_cells: int = Field(description="Cells of 5 cm where the robot's middle touches nothing.")
    reachable_share: float = Field(description="Share of those that the robot reaches from the origin, 0 to 1.")


class PreferenceCount(Model):
    """Number of a world template's preferences that a world satisfies, and their total."""

    satisfied: int = Field(description="Granted.")
    missed: int = Field(description="Not granted, although another world might.")
    contradictory: int = Field(description="Not granted, because another wish or the building itself forbids it.")


class StabilityChecks(Model):
    """Movement of a world's loose objects after small test pushes."""

    pushes: int = Field(description="How many times all of them were pushed, each time differently.")
    pushed_s: float = Field(description="Simulated seconds for which physics ran after each push.")
    push_mps: float = Field(description="Standard deviation of a push along an axis, metres a second.")
    max_moved_m: float = Field(
        description="Furthest that one of them, balls aside, then was from its place, in metres."
    )
    max_sunk_m: float = Field(description="Furthest that one of them was below its place afterwards, in metres.")
    furthest: str | None = Field(description="Id of the one that moved or sank furthest; absent if nothing is loose.")


Guarantee = Literal["reach", "ways", "overlaps", "rest", "parts", "doors", "map", "lidar", "description", "files"]
"""Guarantees of a world that have a place where they can be broken."""


class Fault(Model):
    """A place in a world where a guarantee is broken, or where two of its files do not agree."""

    guarantee: Guarantee = Field(description="The guarantee that is broken.")
    said: str = Field(description="How it is broken, as a sentence without its place.")
    room: str | None = optional("Name of the room it is in; absent outside of all rooms, and of whole files.")
    at: tuple[float, float] | None = optional("Place in the world, x and y in metres; absent of whole files.")

    @classmethod
    def placed(
        cls, guarantee: Guarantee, said: str, place: Sequence[float] | None = None, room: str | None = None
    ) -> "Fault":
        """Makes a fault at a position (x and y, metres), which is rounded to millimetres."""
        at = None if place is None else (round(float(place[0]), 3) + 0.0, round(float(place[1]), 3) + 0.0)
        return cls(guarantee=guarantee, said=said, room=room, at=at)

    @property
    def sentence(self) -> str:
        """Full sentence: how the guarantee is broken, and where."""
        place = "" if self.at is None else f", at ({self.at[0]:.2f}, {self.at[1]:.2f}) m"
        return self.said + place + (f" in {self.room}" if self.room and self.at else "")


class WorldChecks(Model):
    """Measurements that a generated world has to pass to be accepted."""

    robot_radius_m: float = Field(description="Radius in metres of the disc that reachability was checked for.")
    reachable_share: float = Field(
        description="Share of the cells where the disc fits that it reaches from the origin, 0 to 1."
    )
    reachable_cells: dict[str, int] = Field(description="Cells of 5 cm the disc reaches, by room.")
    origin_clear: bool = Field(description="Whether the cylinder of 1 m diameter at the origin is free.")
    max_penetration_m: float = Field(description="Deepest overlap of two solid parts at time 0, in metres.")
    penetrations: int = Field(
        default=0, description="Pairs of solid parts, also of such that never move, that overlap by more than 5 mm."
    )
    penetrating: list[tuple[str, str]] | None = optional(
        "Names of the geoms of those pairs, the deepest first, at most ten; absent in worlds of generators "
        "before 3.0.0, which looked only at parts that can move."
    )
    geoms: int = Field(description="Geoms that collide. `world.xml` has more, which decorate it.")
    closed_off_rooms: list[str] = Field(
        default=[], description="Rooms the disc reaches only when it pushes a door further open than it is at first."
    )
    unreachable_goals: list[str] = Field(default=[], description="Rooms whose goal the disc does not reach.")
    narrowest_passage_m: float | None = optional(
        "Clear width in metres of the narrowest passage; absent in a plan without passages."
    )
    room_graph: list[RoomWay] = Field(default=[], description="The ways between rooms, in the order of `passages`.")
    rooms: list[RoomMeasures] = Field(default=[], description="Each room by itself, in the plan's order.")
    footprint_aspect_ratio: float | None = optional(
        "Extent of the building along x over that along y, between centre lines of walls."
    )
    wishes: PreferenceCount | None = optional("Wishes about plan and interior together.")
    free_bodies: int = Field(default=0, description="Bodies that can move: loose objects and leaves of doors.")
    settle_s: float | None = optional("Simulated seconds for which physics ran from time 0; absent if not run.")
    settled_share: float | None = optional(
        "Share of free bodies that moved less than 1 cm in the settle, 0 to 1; absent if not run."
    )
    max_drift_m: float | None = optional("Furthest that a free body moved in the settle, in metres; absent if not run.")
    stability: StabilityChecks | None = optional(
        "Movement of loose objects after small pushes; absent unless it was asked for."
    )
    reachable_m2: float | None = optional(
        "Area in square metres that the disc's middle reaches; only in worlds that were imported from Gazebo."
    )
    faults: list[Fault] | None = optional(
        "Places where guarantees are broken or where the world's files do not agree; only in the answer of "
        "`robomaker world prove`, which holds them against each other."
    )
    not_compared: dict[Guarantee, str] | None = optional(
        "Reasons why guarantees about files were not looked at, by guarantee; only beside `faults`."
    )

    def absent(self) -> set[str]:
        """Returns the members that are only written if they were measured."""
        return {name for name in ("reachable_m2", "faults", "not_compared") if getattr(self, name) is None}


Point = tuple[float, float]
FurnishedRoomType = Literal[
    "Bedroom", "Bathroom", "Living", "Dining", "Kitchen", "Hallway", "Closet", "Office", "Storage"
]
"""Types of rooms in templates and drawings."""
RoomType = Literal[
    "Bedroom", "Bathroom", "Living", "Dining", "Kitchen", "Hallway", "Closet", "Office", "Storage", "Area"
]
"""Types of rooms of any world; `Area` is a room of an imported world whose type is unknown."""
PreferenceOutcome = Literal["satisfied", "missed", "contradictory"]

SERVICE_ROOM_TYPES: tuple[FurnishedRoomType, ...] = (
    "Bedroom", "Bathroom", "Living", "Dining", "Kitchen", "Hallway", "Closet",
)  # fmt: skip
"""Types of rooms in AWS's templates; the others are extensions."""
ROOM_TYPES: tuple[FurnishedRoomType, ...] = (*SERVICE_ROOM_TYPES, "Office", "Storage")

FLOOR_MATERIALS = ("Carpet", "Concrete", "Floorboards", "Linoleum", "Parquetry", "Tiles")
WALL_MATERIALS = ("Brick", "Concrete", "Stone", "Tiles", "WoodPanels", "WallPaint", "Wallpaper")
MODEL_TYPES = (
    "Baths", "BarCabinets", "Beds", "Bookcases", "CoffeeTables", "ConsoleTables", "CornerCabinets",
    "DeskChairs", "Desks", "DiningChairs", "DiningTables", "DishWashers", "Dressers", "EndAndSideTables",
    "FloorLamps", "Fridges", "LivingRoomChairs", "KitchenIslandsAndCarts", "MediaStorage", "Nightstands",
    "Ottomans", "Ovens", "ServingCarts", "Showers", "SideboardsAndBuffets", "Sofas", "Storage",
    "StorageBenches", "Toilets", "VanityCounters", "WashingMachinesAndDryers",
)  # fmt: skip


class Room(Model):
    """A room of a world's floor plan."""

    name: str = Field(description="The room's name in the template.")
    original_name: str | None = optional("The `OriginalName` in the template, if it has one.")
    type: RoomType = Field(description="The room's type in the template.")
    polygon: list[Point] = Field(
        description="Corners, counter-clockwise, on the centre lines of the walls; axis-aligned."
    )
    area_m2: float = Field(description="Area inside the centre lines of the walls, which the corners lie on.")
    floor_area_m2: float | None = optional(
        "Area of the floor, inside the faces of the walls; absent in worlds of older generators."
    )
    aspect_ratio: float | None = optional(
        "Length over width of the floor, at least 1; older generators took the centre lines of the walls, "
        "the oldest say nothing."
    )
    desired_area_m2: float = Field(description="Area of the floor that the template wished for.")
    desired_aspect_ratio: float = Field(description="Length over width of the floor that the template wished for.")
    goal: Point = Field(description="A free spot a robot can reach, near the room's middle.")
    floor_material: str = Field(default="Floorboards", description="Material of the floor.")
    wall_material: str = Field(default="WallPaint", description="Material of the walls' inner faces.")
    floor_finish: str = Field(default="", description="Look of the floor material; empty: the first.")
    wall_finish: str = Field(default="", description="Look of the wall material; empty: the first.")

    @property
    def called(self) -> str:
        """Display name of the room: its `original_name`, in any script, if it has one."""
        return self.original_name or self.name

    @property
    def floor_m2(self) -> float:
        """Floor area in m²; for worlds of older generators, the area inside the walls' centre lines."""
        return self.area_m2 if self.floor_area_m2 is None else self.floor_area_m2


class Wall(Model):
    """A straight wall segment of a floor plan, already cut at doors and openings."""

    start: Point = Field(description="One end of the centre line.")
    end: Point = Field(description="The other end of the centre line.")
    thickness_m: float = Field(description="Full thickness.")
    exterior: bool = Field(description="Whether the outside lies on one of its sides.")
    rooms: list[str] = Field(description="Names of the one or two rooms it bounds.")
    lintel: bool = Field(default=False, description="Only above a doorway: from `bottom_m` to the ceiling.")
    bottom_m: float = Field(default=0.0, description="Height of the lower edge.")


class Door(Model):
    """A hinged door in a doorway of a world.

    The hinge's axis is at `hinge`, on the face of the wall in `room`. The frame of the door leaf has its origin at the
    hinge and its x axis towards the leaf's free edge: the leaf extends from x = 0 to `leaf_width_m`, and from y = 0 to
    `-swing * thickness_m`, which is away from the side to which it swings.
    """

    id: str = Field(description="Unique in the world, `door-<n>`; name of its body and its joint in the MJCF.")
    hinge: Point = Field(description="Position of the hinge's axis.")
    closed_yaw: float = Field(description="Direction from the hinge along the closed leaf.")
    swing: Literal[1, -1] = Field(description="Opening turns the leaf: 1 counter-clockwise, -1 clockwise, from above.")
    room: str = Field(description="Name of the room it opens into.")
    leaf_width_m: float = Field(description="From the hinge's axis to the leaf's free edge.")
    leaf_height_m: float = Field(description="Height of the leaf itself.")
    thickness_m: float = Field(description="Thickness of the leaf.")
    bottom_m: float = Field(default=0.01, description="Gap under the leaf.")
    max_angle_rad: float = Field(description="The furthest it opens.")
    open_percent: float = Field(default=100.0, ge=0, le=100, description="How far it is open at first; 0 is closed.")
    clear_width_m: float = Field(description="Clear width of the doorway with the leaf fully open.")
    style: str = Field(default="", description="Parametric style that was built, `panelled oak`.")

    @property
    def open_angle_rad(self) -> float:
        """Opening angle of the door when the simulation begins, in radians."""
        return self.max_angle_rad * self.open_percent / 100

    def yaw_at(self, angle_rad: float) -> float:
        """Returns the direction (yaw, radians) from the hinge along the door leaf at an opening angle."""
        return self.closed_yaw + self.swing * angle_rad


class Passage(Model):
    """A doorway or opening between two rooms of a world."""

    kind: PassageKind = Field(description="Doorway: a gap in a wall; Opening: the wall is gone.")
    rooms: tuple[str, str] = Field(description="The two rooms it joins.")
    start: Point = Field(description="One jamb, on the wall's centre line.")
    end: Point = Field(description="The other jamb, on the wall's centre line.")
    width_m: float = Field(description="Clear width between the jambs.")
    requested: bool = Field(description="Whether the template asked for it; otherwise added to connect all rooms.")
    door: Door | None = optional("Its door; absent in openings and in worlds of version 1.")


class Window(Model):
    """A window in an exterior wall (only its picture: the wall behind it is solid)."""

    start: Point = Field(description="One side, on the wall's centre line.")
    end: Point = Field(description="The other side, on the wall's centre line.")
    room: str = Field(description="The room it lights.")


class Furniture(Model):
    """A piece of furniture, or a loose object, in a world."""

    id: str = Field(description="Unique in the world; the prefix of its geoms in the MJCF.")
    model_type: str = Field(description="One of the 31 model types, or the kind of a loose object.")
    style: str = Field(default="", description="Parametric style of the type that was built.")
    room: str = Field(description="Name of the room it stands in.")
    x: float = Field(description="Middle of the footprint.")
    y: float = Field(description="Middle of the footprint.")
    yaw: float = Field(description="Direction its front faces.")
    width_m: float = Field(description="Extent across the facing direction.")
    depth_m: float = Field(description="Extent along the facing direction.")
    height_m: float = Field(description="Extent upwards from `base_m`.")
    base_m: float = Field(default=0.0, description="Height of its lower side; not 0 when it stands on something.")
    movable: bool = Field(default=False, description="Whether it is a free body.")


class Preference(Model):
    """A preference of the world template, and whether the world satisfies it."""

    path: str = Field(description="JSON path in the template body.")
    wish: str = Field(description="The wish in words, with its value.")
    outcome: PreferenceOutcome = Field(description="Whether the world grants it.")
    reason: str = Field(default="", description="Why not; empty when satisfied.")

    @classmethod
    def judged(cls, path: str, wish: str, reason: str = "", outcome: PreferenceOutcome = "missed") -> "Preference":
        """Makes a preference record: satisfied, unless a reason is given why it is not."""
        return cls(path=path, wish=wish, outcome=outcome if reason else "satisfied", reason=reason)


class Floorplan(Model):
    """Floor plan of a world: rooms, walls and passages; all interiors made for it share it."""

    footprint: list[Point] = Field(description="Corners of the building, counter-clockwise, centre lines.")
    ceiling_height_m: float = Field(description="Floor to ceiling.")
    rooms: list[Room] = Field(description="Rooms, in the template's order; materials are set with the interior.")
    walls: list[Wall] = Field(description="All walls, cut at passages, lintels included.")
    passages: list[Passage] = Field(description="All ways between rooms.")
    windows: list[Window] = Field(default=[], description="Windows in exterior walls.")
    wishes: list[Preference] = Field(description="Outcome of the preferences about the plan.")


Light = Literal["day", "evening", "night"]
"""Lighting of a world's model."""
DrawingForm = Literal["svg", "dxf", "nav2-map"]


class DrawnSource(Model):
    """The drawing or map file that a world was imported from."""

    file: str = Field(description="Name of the file.")
    sha256: str = Field(description="SHA-256 of its bytes, hexadecimal; of a map, with its picture's.")
    form: DrawingForm = Field(description="How it was read.")
    metres_per_unit: float = Field(description="Metres of the world for one unit of the drawing; of a map, for a cell.")
    outlines: Literal["faces", "centres"] = Field(
        description="Meaning of the outlines of rooms, as read: the inner faces of their walls, or the walls' middles."
    )
    notes_sha256: str | None = optional(
        "SHA-256 of the YAML file with what the drawing does not say; absent without one."
    )
    origin_m: Point | None = optional(
        "Position of the world's origin in the drawing, x to the right and y up, or in the map's frame, in "
        "metres: a point (x, y) there is at (x - origin_m[0], y - origin_m[1]) in the world, give or take what the "
        "walls were moved by; absent in worlds of generators before 3.2.0."
    )
    left_out: list[str] = Field(
        default=[],
        description="Everything that was taken for neither room, door, window nor name: a count and a kind each.",
    )


class LeftOut(Model):
    """Things of one kind in a world file that the import left out or changed."""

    what: str = Field(description="Kind of thing, in the plural.")
    count: int = Field(description="How many there are.")
    names: list[str] = Field(description="Names or places of the first ones, each once.")


class GazeboSource(Model):
    """The Gazebo world file that a world was imported from."""

    form: Literal["gazebo"] = Field(default="gazebo", description="How it was read.")
    file: str = Field(description="Name of the world file.")
    sha256: str = Field(description="SHA-256 over it, its models and meshes, hexadecimal.")
    sdf_version: str = Field(description="Version of SDF that the file says.")
    origin_m: tuple[float, float, float] = Field(
        description="Position of the world's origin in the file's frame, metres: the start, on the floor. A point p "
        "there is at p - origin_m in the world, turned by -start_yaw."
    )
    start_yaw: float = Field(default=0.0, description="Direction of the start in the file's frame, radians.")
    is_start_chosen: bool = Field(description="Whether the start was chosen here, as none was named.")
    start_from: str | None = optional("Launch file that says the start; absent: the start was named or chosen.")
    models: int = Field(description="Models in it, those in models included.")
    goals: dict[str, Point] = Field(default={}, description="Named goals from the notes, in the world.")
    held: dict[str, str] = Field(
        default={}, description="Bodies that could move and are held, by name, with the reason."
    )
    left_out: list[LeftOut] = Field(default=[], description="All that was left out or mended.")


Source = Annotated[DrawnSource | GazeboSource, Field(discriminator="form")]


class Change(Model):
    """One difference between a variation and the world that it was made from."""

    what: Literal["door", "moved", "removed", "light", "friction"] = Field(description="Kind of difference.")
    thing: str = Field(description="Id of the door or the piece of furniture; `world` for its light.")
    before: str = Field(description="How it was, in words.")
    after: str = Field(description="How it is, in words.")


class Variation(Model):
    """All differences of a variation from the world that it was made from."""

    of_content: str = Field(description="SHA-256 of the bundle of the other world, hexadecimal.")
    of_world: str | None = optional("ARN of the other world; absent if only a folder was given.")
    changes: list[Change] = Field(description="All differences.")


class World(Model):
    """A whole simulation world: floor plan, doors, furniture, materials and checks."""

    schema_version: Literal[1] = Field(default=1, description="Version of this document's form.")
    generator_version: str = Field(description="Version of the generator; same version and seeds, same bytes.")
    template_version: Literal["1", "2"] = Field(
        default="1", description="Version of the template's body; worlds of version 2 have doors."
    )
    floorplan_seed: int = Field(description="Seed of the floor plan.")
    interior_seed: int = Field(description="Seed of the interior.")
    interior_attempt: int = Field(
        default=0, description="Interiors that were made from the seed before and rejected by the checks."
    )
    floorplan: Floorplan = Field(description="The plan, with this world's materials in its rooms.")
    furniture: list[Furniture] = Field(description="Furniture and loose objects.")
    wishes: list[Preference] = Field(description="Outcome of the preferences about the interior.")
    checks: WorldChecks | None = optional("Measured before the world was accepted.")
    source: Source | None = optional("Drawing, map or world file that it was imported from; absent: it was generated.")
    variation: Variation | None = optional(
        "Differences from the world it was made of; absent in worlds made by themselves."
    )
    appearance: Light = Field(default="day", description="How `world.xml` is lit; nothing but looks depends on it.")

    def to_text(self) -> str:
        """Returns the content of `world.json`; optional members are written only for worlds that have them."""
        absent: dict[str, Any] = {name: True for name in ("source", "variation") if getattr(self, name) is None}
        if self.appearance == "day":
            absent["appearance"] = True
        if self.checks is not None:
            absent["checks"] = self.checks.absent()
        if isinstance(self.source, GazeboSource) and self.source.start_from is None:
            absent["source"] = {"start_from"}
        return self.model_dump_json(indent=1, exclude=absent) + "\n"


def bounds(points: Iterable[Point]) -> tuple[float, float, float, float]:
    """Returns the bounding box of 2D points: west, south, east and north."""
    xs, ys = zip(*points, strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def contains(polygon: Sequence[Point], x: float, y: float) -> bool:
    """Returns whether a 2D point is inside a simple polygon (even-odd rule), in metres."""
    inside = False
    previous_x, previous_y = polygon[-1]
    for corner_x, corner_y in polygon:
        if (corner_y > y) != (previous_y > y):
            crossing = corner_x + (y - corner_y) / (previous_y - corner_y) * (previous_x - corner_x)
            inside ^= x < crossing
        previous_x, previous_y = corner_x, corner_y
    return inside
