"""Measurements of a world before it counts as succeeded: the `checks` of `world.json`.

The numbers are taken from what a robot meets, the drawn walls, the map and the compiled model, not from what the
generator meant to build. Which of them a world has to keep is in `tasks.worldforge.guarantees`.
"""

from typing import Literal

from pydantic import Field

from ..wire.base import Model, optional

PassageKind = Literal["Doorway", "Opening"]


class RoomWay(Model):
    """An edge of the room graph: a way between two rooms."""

    rooms: tuple[str, str] = Field(description="The two rooms it joins.")
    kind: PassageKind = Field(description="Doorway: a gap in a wall; Opening: the wall is gone.")
    clear_width_m: float = Field(
        description="Metres between the walls at its sides, measured; less what a fully open door's leaf takes."
    )
    door: str | None = optional("Id of its door; absent where there is none.")


class RoomMeasures(Model):
    """How near one room came to its preferences, and how much of it a robot can use."""

    name: str = Field(description="The room's name.")
    area_error: float = Field(description="(floor area - desired area) / desired area; 0.05 is 5 % too large.")
    aspect_ratio: float = Field(description="Length over width of the floor, at least 1.")
    aspect_error: float = Field(description="(aspect ratio - desired one) / desired one; 0.05 is 5 % too long.")
    fitting_cells: int = Field(description="Cells of 5 cm where the robot's middle touches nothing.")
    reachable_share: float = Field(description="Share of those that the robot reaches from the origin, 0 to 1.")


class PreferenceCount(Model):
    """How many preferences of the template the world satisfies."""

    satisfied: int = Field(description="Granted.")
    missed: int = Field(description="Not granted, although another world might.")
    contradictory: int = Field(description="Not granted, because another wish or the building itself forbids it.")


class StabilityChecks(Model):
    """Movement of loose objects after small pushes."""

    pushes: int = Field(description="How many times all of them were pushed, each time differently.")
    pushed_s: float = Field(description="Simulated seconds for which physics ran after each push.")
    push_mps: float = Field(description="Standard deviation of a push along an axis, metres a second.")
    max_moved_m: float = Field(
        description="Furthest that one of them, balls aside, then was from its place, in metres."
    )
    max_sunk_m: float = Field(description="Furthest that one of them was below its place afterwards, in metres.")
    furthest: str | None = Field(description="Id of the one that moved or sank furthest; absent if nothing is loose.")


class WorldChecks(Model):
    """Measurements that a world has to pass before it counts as succeeded."""

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
    geoms: int = Field(description="Geoms in the model that was measured. `world.xml` has more, which decorate it.")
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
