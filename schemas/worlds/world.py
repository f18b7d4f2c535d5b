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

    rooms: tuple[str, str] = Field(description="Names of the two connected rooms.")
    kind: PassageKind = Field(description="Doorway: a gap in a wall; Opening: the wall is gone.")
    clear_width_m: float = Field(
        description="Metres between the walls at its sides, measured; less what a fully open door's leaf takes."
    )
    door: str | None = optional("Id of the passage's door; absent if it has none.")


class RoomMeasures(Model):
    """Measurements of one room: how close it is to its preferred size and shape, and the floor area a robot can use."""

    name: str = Field(description="Name of the room.")
    area_error: float = Field(description="(floor area - desired area) / desired area; 0.05 is 5 % too large.")
    aspect_ratio: float = Field(description="Length over width of the floor, at least 1.")
    aspect_error: float = Field(description="(aspect ratio - desired one) / desired one; 0.05 is 5 % too long.")
    fitting_cells: int = Field(description="Number of 5 cm cells where the robot's centre touches nothing.")
    reachable_share: float = Field(description="Share of these cells that the robot reaches from the origin, 0 to 1.")


class PreferenceCount(Model):
    """Number of a world template's preferences that a world satisfies, and their total."""

    satisfied: int = Field(description="Number of satisfied preferences.")
    missed: int = Field(description="Number of missed preferences that another world might satisfy.")
    contradictory: int = Field(
        description="Number of preferences that another one, or the building itself, makes impossible."
    )


class StabilityChecks(Model):
    """Movement of a world's loose objects after small test pushes."""

    pushes: int = Field(description="Number of times that all objects were pushed, each time differently.")
    pushed_s: float = Field(description="Simulated seconds for which physics ran after each push.")
    push_mps: float = Field(description="Standard deviation of a push along an axis, in m/s.")
    max_moved_m: float = Field(description="Largest distance that an object, balls excluded, moved, in metres.")
    max_sunk_m: float = Field(description="Largest distance that an object sank, in metres.")
    furthest: str | None = Field(description="Id of the object that moved or sank most; absent if nothing is loose.")


Guarantee = Literal["reach", "ways", "overlaps", "rest", "parts", "doors", "map", "lidar", "description", "files"]
"""Guarantees of a world that have a place where they can be broken."""


class Fault(Model):
    """A place in a world where a guarantee is broken, or where two of its files do not agree."""

    guarantee: Guarantee = Field(description="Name of the broken guarantee.")
    said: str = Field(description="Sentence about how the guarantee is broken, without its place.")
    room: str | None = optional("Name of the room of the fault; absent outside of rooms, and for whole files.")
    at: tuple[float, float] | None = optional(
        "Position of the fault in the world, x and y in metres; absent for whole files."
    )

    @classmethod
    def placed(
        cls, guarantee: Guarantee, said: str, place: Sequence[float] | None = None, room: str | None = None
    ) -> "Fault":
        """Makes a fault at a position (x and y, metres), which is rounded to millimetres.

        `None` leaves the place, or the room, open.
        """
        at = None if place is None else (round(float(place[0]), 3) + 0.0, round(float(place[1]), 3) + 0.0)
        return cls(guarantee=guarantee, said=said, room=room, at=at)

    @property
    def sentence(self) -> str:
        """Full sentence: how the guarantee is broken, and where."""
        place = "" if self.at is None else f", at ({self.at[0]:.2f}, {self.at[1]:.2f}) m"
        return self.said + place + (f" in {self.room}" if self.room and self.at else "")


class WorldChecks(Model):
    """Measurements that a generated world has to pass to be accepted."""

    robot_radius_m: float = Field(description="Radius in metres of the disc with which reachability was checked.")
    reachable_share: float = Field(
        description="Share of the cells where the disc fits that it reaches from the origin, 0 to 1."
    )
    reachable_cells: dict[str, int] = Field(description="Number of 5 cm cells that the disc reaches, by room.")
    origin_clear: bool = Field(description="Whether the cylinder of 1 m diameter at the origin is free.")
    max_penetration_m: float = Field(description="Deepest overlap of two solid parts at time 0, in metres.")
    penetrations: int = Field(
        default=0, description="Number of pairs of solid parts, also of fixed ones, that overlap by more than 5 mm."
    )
    penetrating: list[tuple[str, str]] | None = optional(
        "Names of the geoms of those pairs, the deepest first, at most ten; absent in worlds of generators "
        "before 3.0.0, which looked only at parts that can move."
    )
    geoms: int = Field(description="Number of geoms that collide. `world.xml` has more, which are only visible.")
    closed_off_rooms: list[str] = Field(
        default=[], description="Rooms that the disc reaches only if it pushes a door further open than it is at first."
    )
    unreachable_goals: list[str] = Field(default=[], description="Rooms whose goal the disc does not reach.")
    narrowest_passage_m: float | None = optional(
        "Clear width in metres of the narrowest passage; absent in a plan without passages."
    )
    room_graph: list[RoomWay] = Field(default=[], description="Connections between rooms, in the order of `passages`.")
    rooms: list[RoomMeasures] = Field(default=[], description="Measurements of each room, in the plan's order.")
    footprint_aspect_ratio: float | None = optional(
        "Aspect ratio of the building: extent along x over extent along y, between centre lines of walls."
    )
    wishes: PreferenceCount | None = optional("Preferences about plan and interior together.")
    free_bodies: int = Field(default=0, description="Number of bodies that can move: loose objects and door leaves.")
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
        """Returns the names of optional members that were not measured, and so are not written to `world.json`."""
        return {name for name in ("reachable_m2", "faults", "not_compared") if getattr(self, name) is None}


Point = tuple[float, float]
FurnishedRoomType = Literal[
    "Bedroom", "Bathroom", "Living", "Dining", "Kitchen", "Hallway", "Closet", "Office", "Storage", "Balcony"
]
"""Types of rooms in templates and drawings."""
RoomType = Literal[
    "Bedroom", "Bathroom", "Living", "Dining", "Kitchen", "Hallway", "Closet", "Office", "Storage", "Balcony", "Area"
]
"""Types of rooms of any world; `Area` is a room of an imported world whose type is unknown."""
PreferenceOutcome = Literal["satisfied", "missed", "contradictory"]

SERVICE_ROOM_TYPES: tuple[FurnishedRoomType, ...] = (
    "Bedroom", "Bathroom", "Living", "Dining", "Kitchen", "Hallway", "Closet",
)  # fmt: skip
"""Types of rooms in AWS's templates; the others are extensions."""
INDOOR_ROOM_TYPES: tuple[FurnishedRoomType, ...] = (*SERVICE_ROOM_TYPES, "Office", "Storage")
"""Types of rooms inside the building, which its plan is divided into."""
OUTDOOR_ROOM_TYPE: FurnishedRoomType = "Balcony"
"""Type of rooms outside the building: a railing in place of outer walls, and no ceiling."""
ROOM_TYPES: tuple[FurnishedRoomType, ...] = (*INDOOR_ROOM_TYPES, OUTDOOR_ROOM_TYPE)

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

    name: str = Field(description="Name of the room in the template.")
    original_name: str | None = optional("The `OriginalName` in the template, if it has one.")
    type: RoomType = Field(description="Type of the room in the template.")
    polygon: list[Point] = Field(
        description="Corners, counter-clockwise, on the centre lines of the walls; walls are axis-aligned."
    )
    area_m2: float = Field(description="Area inside the centre lines of the walls, which the corners lie on.")
    floor_area_m2: float | None = optional(
        "Area of the floor, inside the faces of the walls; absent in worlds of older generators."
    )
    aspect_ratio: float | None = optional(
        "Length over width of the floor, at least 1; older generators took the centre lines of the walls, "
        "the oldest say nothing."
    )
    desired_area_m2: float = Field(description="Floor area that the template asked for, or its default, in m².")
    desired_aspect_ratio: float = Field(
        description="Aspect ratio (length over width) of the floor that the template asked for, or its default."
    )
    goal: Point = Field(description="Free position near the room's centre that a robot can reach.")
    floor_material: str = Field(default="Floorboards", description="Material of the floor.")
    wall_material: str = Field(default="WallPaint", description="Material of the walls' inner faces.")
    floor_finish: str = Field(default="", description="Variant of the floor material; empty: the first.")
    wall_finish: str = Field(default="", description="Variant of the wall material; empty: the first.")

    @property
    def called(self) -> str:
        """Display name of the room: its `original_name`, in any script, if it has one."""
        return self.original_name or self.name

    @property
    def floor_m2(self) -> float:
        """Floor area in m²; for worlds of older generators, the area inside the walls' centre lines."""
        return self.area_m2 if self.floor_area_m2 is None else self.floor_area_m2

    @property
    def is_outdoor(self) -> bool:
        """Whether the room is a balcony: it has a railing in place of outer walls, and no ceiling."""
        return self.type == OUTDOOR_ROOM_TYPE


class Wall(Model):
    """A straight wall segment of a floor plan, already cut at doors and openings."""

    start: Point = Field(description="One end of the centre line.")
    end: Point = Field(description="The other end of the centre line.")
    thickness_m: float = Field(description="Full thickness of the wall in metres.")
    exterior: bool = Field(description="Whether one side of the wall is outside the building.")
    rooms: list[str] = Field(description="Names of the one or two rooms at the wall.")
    lintel: bool = Field(
        default=False, description="Whether this part is only above a doorway: from `bottom_m` to the ceiling."
    )
    bottom_m: float = Field(default=0.0, description="Height of the lower edge in metres.")
    top_m: float | None = optional("Height of the upper edge of a balcony's railing in metres; absent: the ceiling.")


class Door(Model):
    """A hinged door in a doorway of a world.

    The hinge's axis is at `hinge`, on the face of the wall in `room`. The frame of the door leaf has its origin at the
    hinge and its x axis towards the leaf's free edge: the leaf extends from x = 0 to `leaf_width_m`, and from y = 0 to
    `-swing * thickness_m`, which is away from the side to which it swings.
    """

    id: str = Field(description="Id of the door, `door-<n>`, and name of its body and joint in the MJCF.")
    hinge: Point = Field(description="Position of the hinge's axis.")
    closed_yaw: float = Field(description="Direction from the hinge along the closed leaf.")
    swing: Literal[1, -1] = Field(
        description="Direction in which the leaf opens: 1 counter-clockwise, -1 clockwise, from above."
    )
    room: str = Field(description="Name of the room into which the door opens.")
    leaf_width_m: float = Field(description="Distance from the hinge's axis to the leaf's free edge, in metres.")
    leaf_height_m: float = Field(description="Height of the leaf in metres.")
    thickness_m: float = Field(description="Thickness of the leaf in metres.")
    bottom_m: float = Field(default=0.01, description="Gap under the leaf in metres.")
    max_angle_rad: float = Field(description="Maximum opening angle in radians.")
    open_percent: float = Field(default=100.0, ge=0, le=100, description="Opening at the beginning; 0 is closed.")
    clear_width_m: float = Field(description="Clear width of the doorway with the leaf fully open, in metres.")
    style: str = Field(default="", description="Style of the door, `panelled oak`.")

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
    rooms: tuple[str, str] = Field(description="Names of the two connected rooms.")
    start: Point = Field(description="Position of one jamb, on the wall's centre line.")
    end: Point = Field(description="Position of the other jamb, on the wall's centre line.")
    width_m: float = Field(description="Clear width between the jambs, in metres.")
    requested: bool = Field(
        description="Whether the template asked for the passage; otherwise it was added to connect all rooms."
    )
    door: Door | None = optional("Id of the passage's door; absent in openings and in worlds of version 1.")


class Window(Model):
    """A window in an exterior wall (only its picture: the wall behind it is solid)."""

    start: Point = Field(description="Position of one side, on the wall's centre line.")
    end: Point = Field(description="Position of the other side, on the wall's centre line.")
    room: str = Field(description="Name of the room with the window.")


class Furniture(Model):
    """A piece of furniture, or a loose object, in a world."""

    id: str = Field(description="Id of the object, unique in the world; prefix of its geoms in the MJCF.")
    model_type: str = Field(description="One of the 31 furniture types, or the kind of a loose object.")
    style: str = Field(default="", description="Style of the object within its type.")
    room: str = Field(description="Name of the room that contains the object.")
    x: float = Field(description="Centre of the footprint, x in metres.")
    y: float = Field(description="Centre of the footprint, y in metres.")
    yaw: float = Field(description="Direction of the object's front, in radians.")
    width_m: float = Field(description="Extent across the direction of the front, in metres.")
    depth_m: float = Field(description="Extent along the direction of the front, in metres.")
    height_m: float = Field(description="Extent upwards from `base_m`, in metres.")
    base_m: float = Field(
        default=0.0, description="Height of the lower side in metres; not 0 if the object is on another one."
    )
    movable: bool = Field(default=False, description="Whether the object is a free body.")


class Preference(Model):
    """A preference of the world template, and whether the world satisfies it."""

    path: str = Field(description="JSON path of the preference in the template body.")
    wish: str = Field(description="Preference as text, with its value.")
    outcome: PreferenceOutcome = Field(description="Whether the world satisfies the preference.")
    reason: str = Field(default="", description="Reason why not; empty if satisfied.")

    @classmethod
    def judged(cls, path: str, wish: str, reason: str = "", outcome: PreferenceOutcome = "missed") -> "Preference":
        """Makes a preference record: satisfied, unless a reason is given why it is not."""
        return cls(path=path, wish=wish, outcome=outcome if reason else "satisfied", reason=reason)


class Floorplan(Model):
    """Floor plan of a world: rooms, walls and passages; all interiors made for it share it."""

    footprint: list[Point] = Field(
        description="Corners of the building with its balconies, counter-clockwise, on centre lines of walls."
    )
    ceiling_height_m: float = Field(description="Ceiling height in metres.")
    rooms: list[Room] = Field(description="Rooms, in the template's order; materials are set with the interior.")
    walls: list[Wall] = Field(description="All walls, cut at passages, including lintels.")
    passages: list[Passage] = Field(description="All connections between rooms.")
    windows: list[Window] = Field(default=[], description="Windows in exterior walls.")
    wishes: list[Preference] = Field(description="Preferences about the floor plan, with whether they are satisfied.")

    def top_of(self, wall: Wall) -> float:
        """Returns the height of a wall's upper edge in metres: the ceiling, or less for a railing."""
        return self.ceiling_height_m if wall.top_m is None else wall.top_m


Light = Literal["day", "evening", "night"]
"""Lighting of a world's model."""
DrawingForm = Literal["svg", "dxf", "nav2-map"]


class DrawnSource(Model):
    """The drawing or map file that a world was imported from."""

    file: str = Field(description="File name of the drawing or map.")
    sha256: str = Field(description="SHA-256 of the file (of a map, with its image), in hexadecimal.")
    form: DrawingForm = Field(description="Format in which it was read.")
    metres_per_unit: float = Field(description="Metres of the world per unit of the drawing; for a map, per cell.")
    outlines: Literal["faces", "centres"] = Field(
        description="Meaning of room outlines in the drawing: inner faces of the walls, or their centre lines."
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
        description="Elements that are neither room, door, window nor name, with counts by kind.",
    )


class LeftOut(Model):
    """Things of one kind in a world file that the import left out or changed."""

    what: str = Field(description="Kind of element, in the plural.")
    count: int = Field(description="Number of elements.")
    names: list[str] = Field(description="Names or positions of the first ones, each once.")


class GazeboSource(Model):
    """The Gazebo world file that a world was imported from."""

    form: Literal["gazebo"] = Field(default="gazebo", description="Format in which it was read.")
    file: str = Field(description="Name of the world file.")
    sha256: str = Field(description="SHA-256 over the file, its models and meshes, in hexadecimal.")
    sdf_version: str = Field(description="SDF version in the file.")
    origin_m: tuple[float, float, float] = Field(
        description="Position of the world's origin in the file's frame, metres: the start, on the floor. A point p "
        "there is at p - origin_m in the world, turned by -start_yaw."
    )
    start_yaw: float = Field(default=0.0, description="Direction of the start in the file's frame, radians.")
    is_start_chosen: bool = Field(description="Whether the start was chosen automatically, as none was named.")
    start_from: str | None = optional(
        "Launch file from which the start was read; absent: the start was named or chosen."
    )
    models: int = Field(description="Number of models, including nested ones.")
    goals: dict[str, Point] = Field(default={}, description="Named goals from the notes file, in the world's frame.")
    held: dict[str, str] = Field(
        default={}, description="Movable bodies that are fixed in this world, by name, with the reason."
    )
    left_out: list[LeftOut] = Field(default=[], description="Elements that were left out or repaired.")


Source = Annotated[DrawnSource | GazeboSource, Field(discriminator="form")]


class Change(Model):
    """One difference between a variation and the world that it was made from."""

    what: Literal["door", "moved", "removed", "light", "friction"] = Field(description="Kind of difference.")
    thing: str = Field(description="Id of the changed door or object; `world` for its light.")
    before: str = Field(description="Original value, as text.")
    after: str = Field(description="New value, as text.")


class Variation(Model):
    """All differences of a variation from the world that it was made from."""

    of_content: str = Field(description="SHA-256 of the other world's files, in hexadecimal.")
    of_world: str | None = optional("ARN of the other world; absent if only a folder was given.")
    changes: list[Change] = Field(description="All differences.")


class World(Model):
    """A whole simulation world: floor plan, doors, furniture, materials and checks."""

    schema_version: Literal[1] = Field(default=1, description="Format version of this document.")
    generator_version: str = Field(
        description="Version of the generator; the same version and seeds give the same bytes."
    )
    template_version: Literal["1", "2"] = Field(
        default="1", description="Version of the template's body; worlds of version 2 have doors."
    )
    floorplan_seed: int = Field(description="Random seed of the floor plan.")
    interior_seed: int = Field(description="Random seed of the interior.")
    interior_attempt: int = Field(
        default=0, description="Number of earlier interiors of this floor plan that the checks rejected."
    )
    floorplan: Floorplan = Field(description="Floor plan, with this world's materials in its rooms.")
    furniture: list[Furniture] = Field(description="Furniture and loose objects.")
    wishes: list[Preference] = Field(description="Preferences about the interior, with whether they are satisfied.")
    checks: WorldChecks | None = optional("Checks that the world passed before it was accepted.")
    source: Source | None = optional(
        "Drawing, map or world file from which the world was imported; absent: it was generated."
    )
    variation: Variation | None = optional(
        "Differences from the world of which this is a variation; absent for other worlds."
    )
    appearance: Light = Field(default="day", description="Lighting of `world.xml`; it has no effect on physics.")

    def to_text(self) -> str:
        """Returns the content of `world.json`; optional members are written only for worlds that have them."""
        absent: dict[str, Any] = {name: True for name in ("source", "variation") if getattr(self, name) is None}
        if self.appearance == "day":
            absent["appearance"] = True
        if self.checks is not None:
            absent["checks"] = self.checks.absent()
        if low := {number: {"top_m"} for number, wall in enumerate(self.floorplan.walls) if wall.top_m is None}:
            absent["floorplan"] = {"walls": low}
        if isinstance(self.source, GazeboSource) and self.source.start_from is None:
            absent["source"] = {"start_from"}
        return self.model_dump_json(indent=1, exclude=absent) + "\n"


def bounds(points: Iterable[Point]) -> tuple[float, float, float, float]:
    """Returns the bounding box of 2D points, of which there is one at least: west, south, east and north."""
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
