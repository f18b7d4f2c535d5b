"""Furnishes one room: required furniture first, then more up to the preferred density."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from math import hypot, inf, pi
from random import Random
from typing import NamedTuple

from ....schemas.worlds.world import Floorplan, Furniture, Room, RoomType, bounds
from ..furniture.catalogue import COMPACT, styles_of
from ..furniture.usual_furniture import FIRST, KITCHEN_RUN, RULES, Density, Rule, first_count, forms_for, front_of
from ..geometry.boxes import Box, Pose, box_of, footprint, pose_of
from ..geometry.parts import Style
from . import candidate_poses
from .room_density import COVERAGE_CAP, MOST_PIECES, wished_share
from .room_space import TALL_M, RoomSpace

NewId = Callable[[str], str]
"""Function that returns a new id for a piece of a furniture kind."""

_SMALL_ROOM_M2 = 15.0
_LARGE_ROOM_M2 = 45.0
_TIGHT_M2 = 6.5
"""Floor area in square metres below which compact pieces are tried first.

Usual ones leave no place for a toilet and shower.
"""
_DENSE_WEIGHT = -2.5
"""Weight of smallness when a piece's styles are ranked in dense rooms, negative: large ones come first if they fit."""

_WIDE_BED_M = 1.2
_FOR_TWO_M2 = 12.0
"""Smallest floor area of a bedroom with a double bed, in square metres.

2.5 m of wall for the bed and both its sides.
"""
_DOUBLE_BED_M, _WIDEST_BED_M = 1.5, 1.8
_MEALS_M = 3.8
"""Largest distance of a dining table from the kitchen, in metres: a few steps with a full plate."""

_TRIES = 6
_HALF_SEAT_M = 0.3
_COMPANIONS = ("beside", "before", "gathered", "around", "desk")
"""Relations to other furniture without which a second piece makes no sense: one chair may be alone, not four."""

_ATTENDANTS = {"Beds": ("Nightstands", 2), "Desks": ("DeskChairs", 1), "DiningTables": ("DiningChairs", 4)}
"""Kinds that each further piece needs as companions, and how many: a bed needs nightstands, a table chairs."""

_WAITING = frozenset(kind for kind, _ in _ATTENDANTS.values())

_TUCKED = ("around", "desk")
_YAWS = (0.0, pi / 2, pi, -pi / 2)


class Group(NamedTuple):
    """Candidate poses that are tried together when furniture is placed."""

    poses: list[Pose]
    partners: tuple[str, ...] = ()
    """Ids of the pieces whose keep-clear zones may be entered."""
    tucked: Box | None = None
    """Footprint of the piece, such as a table, that a candidate piece is pushed under."""


_NO_GROUP = Group([])


@cache
def _schemes() -> tuple[str, ...]:
    """Returns all colour schemes of the catalogue."""
    return tuple(sorted({style.colors for kind in RULES for style in styles_of(kind)}))


def _in_order(kinds: Sequence[str], room_type: RoomType) -> list[str]:
    """Sorts kinds of furniture in the order of placement: essential ones of the room type, then as in the catalogue."""
    wanted, first = set(kinds), FIRST.get(room_type, ())
    return [kind for kind in (*first, *(kind for kind in RULES if kind not in first)) if kind in wanted]


@dataclass
class RoomFurnishing:
    """Furnishes one room: chooses pieces, styles and poses.

    Attributes:
        room: The room.
        space: Free space in the room.
        density: Preferred density of furniture.
        dice: The source of chance.
        new_id: Names pieces.
        items: Pieces placed so far.
        missed: Kinds that found no place, with the reason.
        is_small: Whether it may have compact pieces, since its template wishes it below 10 m2.
    """

    room: Room
    space: RoomSpace
    density: Density
    dice: Random
    new_id: NewId
    items: list[Furniture] = field(default_factory=list)
    missed: dict[str, str] = field(default_factory=dict)
    _taste: dict[str, int] = field(default_factory=dict)
    _kitchens: Sequence[Box] = ()
    """Rectangles of other rooms that are kitchens."""
    is_small: bool = False

    @classmethod
    def begin(
        cls,
        room: Room,
        floorplan: Floorplan,
        density: Density,
        dice: Random,
        new_id: NewId,
        *,
        is_small: bool = False,
    ) -> "RoomFurnishing":
        """Starts the furnishing of an empty room, and chooses its colours."""
        schemes = list(_schemes())
        dice.shuffle(schemes)
        taste = {scheme: rank for rank, scheme in enumerate(schemes)}
        kitchens = [bounds(one.polygon) for one in floorplan.rooms if one.type == "Kitchen" and one.name != room.name]
        space = RoomSpace(room, floorplan, is_small=is_small)
        return cls(room, space, density, dice, new_id, _taste=taste, _kitchens=kitchens, is_small=is_small)

    def place_first_that_fits(self, kinds: Sequence[str]) -> None:
        """Places furniture types in the order given until one fits; that one is placed, and no other."""
        for kind in kinds:
            if not self._place(kind):
                return

    def furnish(self, kinds: Sequence[str]) -> None:
        """Places each furniture type where it fits, then repeats types up to the wished density.

        What stands there already counts.
        """
        self.place_each(kinds)
        self.fill(kinds)

    def place_each(self, kinds: Sequence[str]) -> None:
        """Places the initial number of pieces of each furniture type, in the catalogue's order, as far as they fit.

        The reason for a type of which none fits is added to `missed`.
        """
        listed = _in_order(kinds, self.room.type)
        for kind in listed:
            self._place_first(kind)
            attendant, _ = _ATTENDANTS.get(kind, ("", 0))
            if attendant in listed and self.placed(kind):
                self._place_first(attendant)

    def placed(self, kind: str) -> list[Furniture]:
        """Returns the placed pieces of a furniture type."""
        return [item for item in self.items if item.model_type == kind]

    def _place_first(self, kind: str) -> None:
        for number in range(len(self.placed(kind)), first_count(kind, self.density)):
            if number > 0 and self._full(COVERAGE_CAP[self.density]):
                return
            reason = self._place(kind)
            if reason:
                if number == 0:
                    self.missed[kind] = reason
                return

    def fill(self, kinds: Sequence[str]) -> None:
        """Adds furniture of the given types until the wished density of the room is reached."""
        most = MOST_PIECES[self.density] * max(1.0, (self.room.floor_m2 / 40.0) ** (2 / 3))
        left = [kind for kind in _in_order(kinds, self.room.type) if kind not in self.missed and kind not in _WAITING]
        while left and not self._full(self.wished_share) and len(self.items) < most:
            kind = self.dice.choice(left)
            if len(self.placed(kind)) >= self._most_of(kind) or self._place(kind):
                left.remove(kind)
            elif kind in _ATTENDANTS:
                attendant, number = _ATTENDANTS[kind]
                for _ in range(number if attendant in kinds else 0):
                    self._place(attendant)

    def _most_of(self, kind: str) -> float:
        """Returns the largest number of furnishings of a kind in the room."""
        rule = RULES[kind]
        dines = kind != "DiningTables" or self.room.type != "Living"
        return rule.limit * (1.0 if rule.one_a_room or not dines else max(1.0, self.room.floor_m2 / 30.0))

    @property
    def wished_share(self) -> float:
        """Share of the room's floor that furniture should cover."""
        return wished_share(self.room.type, self.density, self.room.floor_m2)

    @property
    def granted_share(self) -> float:
        """Share of the floor from which the wished density counts as reached; floor that doors need is left out."""
        # A piece more or less is no different density.
        return 0.9 * self.wished_share * max(0.0, 1.0 - self.space.kept_m2 / self.room.floor_m2)

    @property
    def covered_share(self) -> float:
        """Share of the room's floor that furniture covers now."""
        return sum(item.width_m * item.depth_m for item in self.items) / self.room.floor_m2

    def _full(self, share: float) -> bool:
        return self.covered_share >= share

    def _place(self, kind: str) -> str:
        """Places one piece of a kind; returns the reason if it is impossible, else an empty string."""
        lost = [near for near in RULES[kind].near if near in self.missed]
        if RULES[kind].bound and lost and not any(self.placed(near) for near in RULES[kind].near):
            return f"{' and '.join(lost)} found no place in {self.room.name}"
        reason, least_m2 = "", inf
        for style in self.styles(kind):
            why = self._place_style(kind, style)
            if not why:
                return ""
            if style.width_m * style.depth_m < least_m2:  # what the smallest one lacks is what would be needed
                reason, least_m2 = why, style.width_m * style.depth_m
        return reason

    def styles(self, kind: str) -> list[Style]:
        """Returns the styles of a furniture kind to try, those that suit the room's size and colours first."""
        by_form: dict[str, Style] = {}
        for style in sorted(styles_of(kind), key=lambda style: self._taste[style.colors]):
            if self.is_small or not style.form.endswith(COMPACT):
                by_form.setdefault(style.form, style)
        forms = forms_for(kind, self.room.type, list(by_form))
        weight = 1.0 if self.room.floor_m2 < _SMALL_ROOM_M2 else -1.0
        if self.density == "Dense":
            weight = _DENSE_WEIGHT
        noise = {form: self.dice.random() for form in forms}
        sink = any(item.style.startswith("counter-sink") for item in self.items)
        # Chairs of one table and nightstands of one bed are alike.
        for_two = kind == "Beds" and self.room.floor_m2 >= _FOR_TWO_M2 and not self.placed(kind)
        large = self.room.floor_m2 >= _SMALL_ROOM_M2
        used = {item.style for item in self.items if item.model_type == kind} if RULES[kind].bound else set[str]()
        is_tight = self.is_small and self.room.floor_m2 <= _TIGHT_M2

        def rank(form: str) -> float:
            style = by_form[form]
            # A kitchen needs one sink, and then counters.
            repeated = (5.0 if sink else -5.0) * form.startswith("counter-sink")
            alike = -5.0 * (style.name in used or (is_tight and form.endswith(COMPACT)))
            if for_two:
                # Two sleep in a bedroom that has the room; the widest that leaves the rest of it usable comes first.
                return abs(style.width_m - (_WIDEST_BED_M if large else _DOUBLE_BED_M)) + 0.1 * noise[form]
            return weight * 0.4 * style.width_m * style.depth_m + noise[form] + repeated + alike

        return [by_form[form] for form in sorted(forms, key=rank)]

    def style_of(self, kind: str, form: str) -> Style:
        """Returns the style of a furniture form in the colours that suit the room."""
        return min((style for style in styles_of(kind) if style.form == form), key=lambda s: self._taste[s.colors])

    def _place_style(self, kind: str, style: Style) -> str:
        reason = f"no wall of {self.room.name} has {style.width_m:.2f} m free"
        front = front_of(kind, self.room.type)
        if front:
            reason += f" with {front:g} m before it"
        for group in self._groups(kind, style):
            if not group.poses:
                continue
            tries = 0
            for pose in sorted(group.poses, key=lambda pose: -pose.score):
                if not self.fits(kind, style, pose, group):
                    continue
                if self.space.stays_open(*self._takes(kind, style, pose)):
                    self.place_at(kind, style, pose)
                    return ""
                reason = f"a {style.form} of {style.width_m:.2f} m would block the ways through {self.room.name}"
                tries += 1
                if tries == _TRIES:
                    break
            if not tries and RULES[kind].spot != "wall":
                size = f"{style.width_m:.2f} m x {style.depth_m:.2f} m"
                reason = f"no free place of {size} with room around it in {self.room.name}"
        if RULES[kind].bound and RULES[kind].relation != "before":
            partners = " or ".join(near for near in RULES[kind].near if self.placed(near))
            reason = f"no free place left at the {partners} of {self.room.name}" if partners else reason
        return reason

    def fits(self, kind: str, style: Style, pose: Pose, group: Group = _NO_GROUP) -> bool:
        """Whether a piece fits at a pose with its clearances; robots' paths are not checked."""
        box = footprint(pose, style.width_m, style.depth_m)
        tall = style.height_m > TALL_M or RULES[kind].hides_window
        space = self.space
        if not space.admits(box, tall=tall, partners=group.partners, tucked=group.tucked):
            return False
        if RULES[kind].seat_m and not space.admits(self._takes(kind, style, pose)[1]):
            return False
        for zones in self._zones(kind, style, pose):
            if all(space.is_clear(zone, group.tucked) for zone in zones):
                return True
        return False

    def _takes(self, kind: str, style: Style, pose: Pose) -> list[Box]:
        """Returns the boxes that a piece and, if it has one, its chair cover at a pose; the chair's is the second."""
        box, seat = footprint(pose, style.width_m, style.depth_m), RULES[kind].seat_m
        if not seat:
            return [box]
        right, left = candidate_poses.DESK_SEAT_M - _HALF_SEAT_M, candidate_poses.DESK_SEAT_M + _HALF_SEAT_M
        return [box, pose.box(style.depth_m / 2, style.depth_m / 2 + seat, right, left)]

    def _zones(self, kind: str, style: Style, pose: Pose) -> Iterator[list[Box]]:
        """Yields alternatives of the boxes that must stay free around a piece; one of the lists is enough."""
        rule, half_depth, half_width = RULES[kind], style.depth_m / 2, style.width_m / 2
        if rule.around_m:
            reach = rule.around_m
            yield [pose.box(-half_depth - reach, half_depth + reach, -half_width - reach, half_width + reach)]
            if kind == "DiningTables" and style.width_m > style.depth_m:  # an end may be at a wall, without a chair
                yield [pose.box(-half_depth - reach, half_depth + reach, -half_width, half_width)]
            return
        front = front_of(kind, self.room.type)
        zones = [pose.box(half_depth, half_depth + front, -half_width, half_width)] if front else []
        if not rule.beside_m:
            yield zones
            return
        reach = rule.beside_m
        left = pose.box(-half_depth, half_depth, half_width, half_width + reach)
        right = pose.box(-half_depth, half_depth, -half_width - reach, -half_width)
        if kind == "Beds" and style.width_m < _WIDE_BED_M:
            yield [*zones, left]
            yield [*zones, right]
        else:
            yield [*zones, left, right]

    def place_at(self, kind: str, style: Style, pose: Pose, *, zone: bool = True) -> Furniture:
        """Places a piece of furniture at a pose that has been checked, rounded to millimetres.

        Args:
            kind: Kind of the piece.
            style: Style of the piece.
            pose: Pose that was checked before.
            zone: Whether its clearances are kept; a counter in the corner of a kitchen has none.

        Returns:
            The new piece, which is added to `items`.
        """
        item = Furniture(
            id=self.new_id(kind),
            model_type=kind,
            style=style.name,
            room=self.room.name,
            x=round(pose.x, 3) + 0.0,
            y=round(pose.y, 3) + 0.0,
            yaw=_YAWS[pose.quarter],
            width_m=style.width_m,
            depth_m=style.depth_m,
            height_m=style.height_m,
        )
        self.items.append(item)
        box = box_of(item)
        zones: list[Box] = []
        if zone:
            choices = list(self._zones(kind, style, pose))
            zones = next((one for one in choices if all(map(self.space.is_clear, one))), choices[0])
        self.space.add(item.id, box, zones)
        return item

    def _groups(self, kind: str, style: Style) -> Iterator[Group]:
        """Yields groups of candidate poses for a piece, the most suitable group first."""
        rule = RULES[kind]
        partners = [item for near in rule.near for item in self.items if item.model_type == near]
        if rule.relation == "run" and self.room.type in ("Kitchen", "Bathroom"):
            yield from self._run(kind, rule, style, partners)
            return
        if kind == "Sofas" and self.placed(kind):
            # A second one stands at the end of the coffee table, at a right angle to the first.
            partners, rule = self.placed("CoffeeTables"), replace(rule, relation="gathered", bound=True)
        elif rule.relation == "facing" and partners:
            walls = self._alone(kind, rule, style)
            yield Group(
                [pose._replace(score=pose.score + candidate_poses.facing_bonus(pose, partners[0])) for pose in walls]
            )
            return
        if rule.relation not in ("run", "facing"):
            for partner in self._free_partners(kind, rule, partners):
                at_table = self.placed("Sofas") if rule.relation in ("before", "gathered") else []
                owners = (partner.id, *(item.id for item in at_table))
                tucked = box_of(partner) if rule.relation in _TUCKED else None
                yield Group(self._relate(rule, partner, style), owners, tucked)
        companion = rule.relation in _COMPANIONS and (rule.relation != "gathered" or self.density != "Dense")
        repeated = bool(self.placed(kind)) and (rule.bound or companion)
        if not repeated and not (rule.bound and partners):
            yield Group(self._alone(kind, rule, style))

    def _free_partners(self, kind: str, rule: Rule, partners: list[Furniture]) -> list[Furniture]:
        """Returns the pieces that still have no companion of this kind.

        So no sofa gets two lamps while another has none. Tables with the fewest chairs come first.
        """
        there = self.placed(kind)
        if rule.relation == "around":
            return sorted(partners, key=lambda table: sum(candidate_poses.sits_at(chair, table) for chair in there))
        if rule.relation != "beside" or kind == "Nightstands":
            return partners
        return [
            partner
            for partner in partners
            if not any(hypot(one.x - partner.x, one.y - partner.y) < partner.width_m / 2 + 0.7 for one in there)
        ]

    def _relate(self, rule: Rule, partner: Furniture, style: Style) -> list[Pose]:
        if rule.relation == "beside":
            return candidate_poses.beside(partner, style, self.dice)
        if rule.relation == "before":
            return candidate_poses.before(partner, style, rule.gap_m, self.dice)
        if rule.relation == "gathered":
            return candidate_poses.gathered(partner, style, rule.gap_m, self.dice)
        if rule.relation == "around":
            return candidate_poses.around(partner, style)
        return candidate_poses.at_desk(partner, style)

    def _alone(self, kind: str, rule: Rule, style: Style) -> list[Pose]:
        if rule.spot == "corner":
            return candidate_poses.in_corners(self.space, style, self.dice)
        if rule.spot == "open":
            run = [item for item in self.items if item.model_type in KITCHEN_RUN]
            poses = candidate_poses.in_the_open(self.space, self.dice, run if self.room.type == "Kitchen" else [])
            return (
                [pose._replace(score=self._dining_score(pose)) for pose in poses] if kind == "DiningTables" else poses
            )
        front, tall = front_of(kind, self.room.type), style.height_m > TALL_M or rule.hides_window
        return candidate_poses.against_walls(self.space, style, front, rule.prefer, self.dice, tall=tall)

    @property
    def dines(self) -> bool:
        """Whether the room has a dining table that is not far from the kitchen."""
        tables = self.placed("DiningTables")
        return any(self._to_kitchen_m(pose_of(table)) <= _MEALS_M for table in tables)

    def _to_kitchen_m(self, pose: Pose) -> float:
        return min((candidate_poses.distance(pose, kitchen) for kitchen in self._kitchens), default=0.0)

    def _dining_score(self, pose: Pose) -> float:
        """Scores a dining table's pose: central in a dining room, at the side in a living room, near the kitchen."""
        away = self._to_kitchen_m(pose)
        if self.room.type != "Living":
            return pose.score - max(0.0, away - _MEALS_M)
        return -away + (min(0.0, pose.score - candidate_poses.OPEN_SCORE) if self._dines_aside else -pose.score)

    @property
    def _dines_aside(self) -> bool:
        """Whether a living room is so small that its dining table is placed wherever the kitchen is near."""
        return self.room.type == "Living" and self.room.floor_m2 < _LARGE_ROOM_M2

    def _run(self, kind: str, rule: Rule, style: Style, run: list[Furniture]) -> Iterator[Group]:
        """Yields poses next to units of the kitchen row, else along a wall; never a second separate counter."""
        run = [item for item in run if self.room.type == "Kitchen" or item.model_type == kind]
        if run:
            yield Group([pose for item in run for pose in candidate_poses.next_to(item, style)])
        if not (self.room.type == "Kitchen" and kind == "Storage" and run):
            yield Group(self._alone(kind, rule, style))
