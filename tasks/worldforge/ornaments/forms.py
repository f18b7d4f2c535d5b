"""Procedural shapes that draw parts of furniture, and the meshes that a world has for them.

What collides and what is measured are the primitives that furniture is made of; these shapes are for the eye.
"""

from collections.abc import Iterator
from functools import lru_cache
from math import cos, sin

from ..geometry.parts import Color, Part, Vector
from . import shapes
from .ornaments import Ornament, color_look
from .shapes import Shape, bevelled, lathed

_ROUNDING_M = 0.012

FORMS: dict[str, Shape] = {
    "block": shapes.block,
    "bevel": lambda size: bevelled(size, _ROUNDING_M),
    "padded": lambda size: bevelled(size, 0.35 * min(size)),
    "soft": lambda size: bevelled(size, 0.045),
    "cushion": shapes.stuffed,
    "crumpled": shapes.crumpled,
    "bush": shapes.bush,
    "sprigs": shapes.sprigs,
    "flowers": shapes.flowers,
    "fruit": shapes.fruit,
    "kettle": shapes.kettle,
    "pan": shapes.pan,
    "draped": shapes.draped,
    "curtain": shapes.curtain,
    "mug": shapes.mug,
    "pot": lathed(((0.7, 0.0), (0.92, 0.82), (1.0, 0.82), (1.0, 1.0), (0.86, 1.0), (0.84, 0.88))),
    "vase": lathed(((0.6, 0.0), (0.86, 0.14), (1.0, 0.38), (0.84, 0.66), (0.44, 0.86), (0.56, 1.0), (0.4, 0.98))),
    "bottle": lathed(((0.92, 0.0), (1.0, 0.04), (1.0, 0.58), (0.4, 0.76), (0.34, 0.97), (0.42, 1.0))),
    "jar": lathed(((0.9, 0.0), (1.0, 0.06), (1.0, 0.74), (0.86, 0.8), (0.94, 0.82), (0.94, 1.0))),
    "bowl": lathed(((0.42, 0.0), (0.5, 0.08), (0.86, 0.5), (1.0, 1.0), (0.94, 1.0), (0.8, 0.56), (0.4, 0.16))),
    "plate": lathed(((0.6, 0.0), (0.68, 0.3), (1.0, 1.0), (0.98, 1.0), (0.66, 0.5))),
    "shade": lathed(((0.96, 0.0), (1.0, 0.0), (0.66, 1.0), (0.62, 1.0))),
    "glass": lathed(((0.74, 0.0), (1.0, 1.0), (0.94, 1.0), (0.7, 0.08))),
    "lamp": lathed(((1.0, 0.0), (1.0, 0.1), (0.3, 0.2), (0.42, 0.5), (0.2, 0.9), (0.2, 1.0))),
    "ball": lathed([(sin(a), (1 - cos(a)) / 2) for a in (0.45, 0.9, 1.35, 1.8, 2.25, 2.7)]),
}
"""Shapes by their names."""

# By kinds of furniture: beginnings of the names of parts, the longest that fits counts.
_CLOTH = {"cushion": "soft", "back-cushion": "soft", "pillow": "cushion", "base": "soft", "back": "soft", "arm": "soft"}
_GREEN = {"plant": "bush", "bunch": "sprigs", "moss": "bush", "pot": "pot", "vase": "vase"}
_LAMP = {"lamp-shade": "shade", "lamp-foot": "pot", "shade": "shade"}
_SET = {"bowl": "bowl", "tray": "bowl", "fruit": "fruit", "bottle": "bottle", "cup": "glass", "glass": "glass"}
_EVERYWHERE = {**_GREEN, **_LAMP, **_SET, "top": "bevel", "teapot": "kettle", "seat": "bevel", "pad": "padded"}
_OF_KIND: dict[str, dict[str, str]] = {
    "Beds": {
        "mattress": "soft", "duvet": "soft", "fold": "soft", "throw": "soft", "pillow": "cushion",
        "cushion": "cushion", "headboard": "bevel", "frame": "bevel",
    },
    "Clothes": {"lower": "crumpled", "upper": "crumpled"},
    "Cup": {"cup": "mug"},
    "DeskChairs": {"cushion": "cushion", "back": "padded", "seat": "padded", "lumbar": "cushion"},
    "DiningChairs": {"back": "bevel"},
    "FloorLamps": {"foot": "pot"},
    "LivingRoomChairs": _CLOTH,
    "Ottomans": {"cushion": "padded", "body": "soft"},
    "Plate": {"plate": "plate"},
    "Sofas": _CLOTH,
    "StorageBenches": {"cushion": "padded"},
    "Toilets": {"bowl": "", "seat": ""},
    "VanityCounters": {"basin": "bowl", "bowl": ""},
}  # fmt: skip


_LEAFY = ("bush", "sprigs", "fruit", "cushion", "crumpled")
"""Forms in place of ellipsoids."""
_TURNED = ("bottle", "bowl", "glass", "jar", "kettle", "mug", "plate", "pot", "shade", "vase")
"""Forms of what is round."""


def form_of(kind: str, part: Part) -> str:
    """How a part is drawn: a name in `FORMS`; empty: as the primitive that it is."""
    return _form(kind, part.name, part.shape)


@lru_cache(maxsize=2048)
def _form(kind: str, part: str, shape: str) -> str:
    names = {**_EVERYWHERE, **_OF_KIND.get(kind, {})}
    fits = [name for name in names if part == name or part.startswith(f"{name}-")]
    form = names[max(fits, key=len)] if fits else ""
    if shape == "ellipsoid":
        return form if form in _LEAFY else ""
    return form if (shape == "cylinder") == (form in _TURNED) else ""


class Shapes:
    """The meshes that a world's file has, each once."""

    def __init__(self) -> None:
        """Begins without any."""
        self._lines: dict[str, str] = {}

    def named(self, form: str, size: Vector) -> str:
        """The name of a mesh of this form and size; it is made if there is none yet."""
        name = "_".join(["shape", form, *(str(round(1000 * extent)) for extent in size)])
        if name not in self._lines:
            self._lines[name] = _mesh_line(name, form, size)
        return name

    def drawn(self, name: str, form: str, size: Vector, center: Vector, color: Color, yaw: float) -> Ornament:
        """A shape that is seen somewhere, turned about z."""
        return Ornament(name, "mesh", center, (), color_look(color), turned_quat(yaw), self.named(form, size))

    def lines(self) -> Iterator[str]:
        """All of them as assets of MJCF."""
        return iter(self._lines.values())


@lru_cache(maxsize=1024)
def _mesh_line(name: str, form: str, size: Vector) -> str:
    """Most worlds of a template have the same shapes."""
    return FORMS[form](size).line(name)


def turned_quat(yaw: float) -> str:
    """A turn about z as MJCF; empty: none."""
    return f"{cos(yaw / 2):.6f} 0 0 {sin(yaw / 2):.6f}" if yaw else ""
