"""Light of a world: the appearances of one and the same world, and its model with another one.

An appearance changes lights, the sky and what shines by itself; nothing that moves, collides or weighs.
"""

import re
from dataclasses import dataclass, replace
from random import Random

Rgb = tuple[float, float, float]

RANDOM = "random"
"""Name that chooses an appearance by chance: one of those that differ in light, a little brighter or darker."""

DAY = "day"


@dataclass(frozen=True, slots=True)
class Appearance:
    """Lighting of a simulation world: colours of sun, lamps, ambient light and sky, and whether shadows are drawn."""

    sun: Rgb
    """Colour of the sun's light; at night of the moon's."""
    lamps: Rgb
    ambient: Rgb
    """Light that comes from everywhere."""
    headlight: float
    """Light from where the camera is."""
    ceiling: float
    """Brightness of ceilings by themselves, since no light from above reaches them."""
    shades: float
    """The same of lamp shades."""
    sky: Rgb | None
    """Colour of the sky; absent: the day's, with all that is seen from windows."""
    shadows: bool = True
    """Whether the sun casts shadows, which takes a renderer longer than all the rest."""


APPEARANCES: dict[str, Appearance] = {
    DAY: Appearance((0.8, 0.75, 0.66), (0.27, 0.26, 0.23), (0.37, 0.37, 0.37), 0.08, 0.35, 0.5, None),
    "evening": Appearance(
        (0.34, 0.2, 0.1), (0.34, 0.28, 0.19), (0.3, 0.26, 0.25), 0.06, 0.22, 0.9, (0.68, 0.5, 0.46)
    ),
    "night": Appearance((0.05, 0.06, 0.09), (0.0, 0.0, 0.0), (0.19, 0.21, 0.27), 0.06, 0.1, 0.0, (0.05, 0.07, 0.13)),
    "lamps": Appearance((0.0, 0.0, 0.0), (0.52, 0.45, 0.33), (0.24, 0.22, 0.19), 0.06, 0.25, 1.0, (0.04, 0.05, 0.1)),
    "quick": Appearance((0.28, 0.27, 0.24), (0.0, 0.0, 0.0), (0.5, 0.5, 0.5), 0.12, 0.45, 0.4, None, shadows=False),
}  # fmt: skip
"""Appearances by name; `quick` is day without shadows and lamps, for cameras that take many pictures."""

_DRAWN = (DAY, "evening", "night", "lamps")
_LEAST, _MOST = 0.8, 1.25


def appearance_named(name: str, seed: int = 0) -> Appearance:
    """Returns a lighting of a world by name, or a random one.

    Args:
        name: one of `APPEARANCES`, or `random`.
        seed: what `random` draws from; equal seeds give equal light.

    Raises:
        ValueError: no lighting has this name; the message lists the names.
    """
    if name == RANDOM:
        dice = Random(seed)  # noqa: S311 (chance, not secrecy)
        return _brighter(APPEARANCES[dice.choice(_DRAWN)], dice.uniform(_LEAST, _MOST))
    if name not in APPEARANCES:
        known = ", ".join((*APPEARANCES, RANDOM))
        raise ValueError(f"appearance {name!r}: there is none of this name; one of {known} would be right")
    return APPEARANCES[name]


def _brighter(appearance: Appearance, by: float) -> Appearance:
    return replace(
        appearance,
        sun=_times(appearance.sun, by), lamps=_times(appearance.lamps, by), ambient=_times(appearance.ambient, by),
    )  # fmt: skip


def _times(color: Rgb, by: float) -> Rgb:
    red, green, blue = (round(share * by, 3) for share in color)
    return red, green, blue


def relit(mjcf: str, appearance: Appearance) -> str:
    """Returns the MJCF text of a world's model with another lighting.

    Worlds of earlier generators have no lamps and no ceilings that shine; the rest of them changes.
    """
    lit = appearance
    text = _set(mjcf, "<headlight ", ambient=_text(*lit.ambient), diffuse=_text(*[lit.headlight] * 3))
    # Dark lights stay in the scene, so that cameras can light the model otherwise again.
    text = _set(text, '<light name="sun" ', diffuse=_text(*lit.sun), castshadow=_said(lit.shadows and any(lit.sun)))
    text = _set(text, '<light name="lamp_', diffuse=_text(*lit.lamps))
    text = _set(text, '<material name="ceiling" ', emission=f"{lit.ceiling:g}")
    text = _set(text, '<material name="lamp_shade" ', emission=f"{lit.shades:g}")
    if lit.sky is None:
        return text
    sky = f'<texture name="sky" type="skybox" {sky_look(lit.sky)} width="64" height="384"/>'
    return re.sub(r'<texture name="sky" [^>]*/>', sky, text)


def sky_look(color: Rgb) -> str:
    """Returns MJCF texture attributes for a sky of one colour that is darker below."""
    return f'builtin="gradient" rgb1="{_text(*color)}" rgb2="{_text(*(share / 3 for share in color))}"'


def _set(mjcf: str, start: str, **attributes: str) -> str:
    """Sets attributes of all elements that start like this."""

    def changed(found: re.Match[str]) -> str:
        element = found.group()
        for name, value in attributes.items():
            element = re.sub(rf' {name}="[^"]*"', "", element).replace("/>", f' {name}="{value}"/>')
        return element

    return re.sub(rf"{re.escape(start)}[^>]*/>", changed, mjcf)


def _said(value: bool) -> str:
    return "true" if value else "false"


def _text(*values: float) -> str:
    return " ".join(f"{round(value, 4):g}" for value in values)
