"""Furnishes one room: what must be there first, then more until the room is as full as wished."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import sqrt

import numpy as np

from ...schemas.world import Floorplan, Furniture, Room
from . import candidates
from .arrangement import COVERAGE, COVERAGE_CAP, MOST_PIECES, RULES, Density, Rule, first_count, forms_for
from .candidates import Poses, Side
from .furniture import styles_of
from .parts import Style
from .placement import TALL_M, RoomSpace

NewId = Callable[[str], str]
"""Gives a kind's next free id."""

_SMALL_ROOM_M2 = 15.0
_TRIES = 6

_COMPANIONS = ("beside", "before", "around", "desk")
"""Relations without which a second piece makes no sense: one chair may stand alone, not four."""


@dataclass
class RoomFurnishing:
    """A room on its way to being furnished.

    Attributes:
      room: the room.
      space: what is still free in it.
      density: how full it should get.
      rng: the source of chance.
      new_id: names pieces.
      items: pieces placed so far.
      missed: kinds that found no place, with the reason.
    """

    room: Room
    space: RoomSpace
    sides: list[Side]
    density: Density
    rng: np.random.Generator
    new_id: NewId
    items: list[Furniture] = field(default_factory=list)
    missed: dict[str, str] = field(default_factory=dict)

    @classmethod
    def begin(
        cls, room: Room, floorplan: Floorplan, density: Density, rng: np.random.Generator, new_id: NewId
    ) -> "RoomFurnishing":
        """An empty room."""
        space = RoomSpace(room, floorplan)
        schemes = sorted({style.colors for kind in RULES for style in styles_of(kind)})
        made = cls(room, space, candidates.sides_of(room, floorplan), density, rng, new_id)
        made._taste = {scheme: rank for rank, scheme in enumerate(rng.permutation(schemes))}
        return made

    def __post_init__(self) -> None:
        self._taste: dict[str, int] = {}

    def furnish(self, kinds: Sequence[str]) -> None:
        """Places each kind at least once where it fits, then repeats kinds up to the wished density."""
        listed = [kind for kind in RULES if kind in set(kinds)]
        for kind in listed:
            self._place_first(kind)
        self._fill([kind for kind in listed if kind not in self.missed])

    def _place_first(self, kind: str) -> None:
        for number in range(first_count(kind, self.density)):
            if number > 0 and self._full(COVERAGE_CAP):
                return
            reason = self._place(kind)
            if reason:
                if number == 0:
                    self.missed[kind] = reason
                return

    def _fill(self, kinds: list[str]) -> None:
        scale = max(1.0, self.room.area_m2 / 30.0)
        most = MOST_PIECES[self.density] * max(1.0, sqrt(self.room.area_m2 / 40.0))
        left = list(kinds)
        while left and not self._full(COVERAGE) and len(self.items) < most:
            kind = left[int(self.rng.integers(len(left)))]
            placed = Counter(item.model_type for item in self.items)[kind]
            if placed >= RULES[kind].limit * scale or self._place(kind):
                left.remove(kind)

    @property
    def covered_share(self) -> float:
        """Share of the floor under furniture."""
        return sum(item.width_m * item.depth_m for item in self.items) / self.room.area_m2

    def _full(self, shares: dict[Density, float]) -> bool:
        return self.covered_share >= shares[self.density]

    def _place(self, kind: str) -> str:
        """Places one piece; returns why not, or an empty string."""
        reason = ""
        for style in self._styles(kind):
            reason = self._place_style(kind, style)
            if not reason:
                return ""
        return reason

    def _styles(self, kind: str) -> list[Style]:
        """Styles to try: those that suit the room's size first, in the room's colours."""
        by_form: dict[str, list[Style]] = {}
        for style in styles_of(kind):
            by_form.setdefault(style.form, []).append(style)
        forms = forms_for(kind, self.room.type, list(by_form))
        weight = 1.0 if self.room.area_m2 < _SMALL_ROOM_M2 else -1.0
        noise = dict(zip(forms, self.rng.random(len(forms)), strict=True))
        present = Counter(item.style.rsplit(" ", 1)[0] for item in self.items)

        def rank(form: str) -> float:
            sample = by_form[form][0]
            # A kitchen needs one sink, and then counters.
            repeated = {"counter-sink": 5.0, "counter": -5.0}.get(form, 0.0) * (1 if present["counter-sink"] else -1)
            return weight * 0.4 * sample.width_m * sample.depth_m + float(noise[form]) + repeated

        ordered = sorted(forms, key=rank)
        return [min(by_form[form], key=lambda style: self._taste[style.colors]) for form in ordered]

    def _place_style(self, kind: str, style: Style) -> str:
        rule = RULES[kind]
        reason = f"no wall of {self.room.name} is long enough for {style.width_m:.2f} m"
        for poses, partner in self._attempts(kind, rule, style):
            if not len(poses):
                continue
            footprints, zones = poses.footprints(style), poses.zones(style, rule.front_m)
            tucked = None
            if partner is not None and rule.relation in ("around", "desk"):
                tucked = _footprint(partner)
            owner = "" if partner is None else partner.id
            fitting = self.space.fits(footprints, zones, tall=style.height_m > TALL_M, partner=owner, tucked=tucked)
            indices = np.nonzero(fitting)[0]
            reason = f"no free place of {style.width_m:.2f} m x {style.depth_m:.2f} m in {self.room.name}"
            for index in indices[np.argsort(-poses.score[indices], kind="stable")][:_TRIES]:
                if self.space.stays_open(footprints[index : index + 1]):
                    self._stand(kind, style, poses, int(index), rule)
                    return ""
                reason = f"it would block the ways through {self.room.name}"
        return reason

    def _stand(self, kind: str, style: Style, poses: Poses, index: int, rule: Rule) -> None:
        """Writes the piece down, on whole millimetres."""
        quarter = int(poses.quarter[index])
        item = Furniture(
            id=self.new_id(kind),
            model_type=kind,
            style=style.name,
            room=self.room.name,
            x=round(float(poses.x[index]), 3) + 0.0,
            y=round(float(poses.y[index]), 3) + 0.0,
            yaw=[0.0, np.pi / 2, np.pi, -np.pi / 2][quarter],
            width_m=style.width_m,
            depth_m=style.depth_m,
            height_m=style.height_m,
        )
        self.items.append(item)
        zone = poses.zones(style, rule.front_m)[index : index + 1]
        self.space.add(item.id, poses.footprints(style)[index : index + 1], zone)

    def _attempts(self, kind: str, rule: Rule, style: Style) -> list[tuple[Poses, Furniture | None]]:
        """Groups of poses, the most fitting first."""
        partners = [item for near in rule.near for item in self.items if item.model_type == near]
        related: list[tuple[Poses, Furniture | None]] = []
        if rule.relation == "run":
            if self.room.type in ("Kitchen", "Bathroom"):
                return self._run(kind, rule, style, partners)
        elif rule.relation == "facing":
            related = self._facing(rule, style, partners)
        else:
            for partner in partners:
                related.append((self._relate(rule, partner, style), partner))
        if rule.relation in _COMPANIONS and any(item.model_type == kind for item in self.items):
            return related
        return [*related, (self._alone(rule, style), None)]

    def _relate(self, rule: Rule, partner: Furniture, style: Style) -> Poses:
        if rule.relation == "beside":
            return candidates.beside(partner, style, self.rng)
        if rule.relation == "before":
            return candidates.before(partner, style, rule.gap_m, self.rng)
        if rule.relation == "around":
            return candidates.around(partner, style)
        return candidates.at_desk(partner, style)

    def _alone(self, rule: Rule, style: Style) -> Poses:
        if rule.spot == "corner" and self.sides:
            return candidates.in_corners(self.sides, style, self.rng)
        if rule.spot == "open":
            return candidates.in_the_open(self.space.bounds, self.rng)
        return candidates.against_walls(self.sides, style, rule.prefer, self.rng)

    def _run(self, kind: str, rule: Rule, style: Style, run: list[Furniture]) -> list[tuple[Poses, Furniture | None]]:
        """Edge to edge with what is there, else along a wall near it."""
        run = [item for item in run if self.room.type == "Kitchen" or item.model_type == kind]
        flush = [candidates.next_to(item, style) for item in run]
        walls = self._alone(rule, style)
        if run:
            walls = walls.plus(candidates.run_bonus(walls, style, run))
        return [*([(candidates.joined(flush), None)] if flush else []), (walls, None)]

    def _facing(self, rule: Rule, style: Style, partners: list[Furniture]) -> list[tuple[Poses, Furniture | None]]:
        if not partners:
            return []
        walls = self._alone(rule, style)
        walls = walls.plus(candidates.facing_bonus(walls, partners[0]))
        return [
            (candidates.joined([candidates.facing(partners[0], style, self.rng).plus(np.full(100, 0.6)), walls]), None)
        ]


def _footprint(item: Furniture) -> np.ndarray:
    turned = candidates.quarter_of(item) % 2 == 1
    half_x, half_y = (item.width_m / 2, item.depth_m / 2) if turned else (item.depth_m / 2, item.width_m / 2)
    return np.array([[item.x - half_x, item.y - half_y, item.x + half_x, item.y + half_y]])
