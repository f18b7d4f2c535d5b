"""Lighting of a world: named appearances, and replacement of the lighting in a world's MJCF.

An appearance changes lights, sky and luminous materials, but nothing that affects physics.
"""

import re
from dataclasses import dataclass, replace
from random import Random

Rgb = tuple[float, float, float]

RANDOM = "random"
"""Name that chooses a random appearance: one with other light, slightly brighter or darker."""

DAY = "day"


@dataclass(frozen=True, slots=True)
class Appearance:
    """Lighting of a simulation world: colours of sun, lamps, ambient light and sky, and whether shadows are drawn."""

    sun: Rgb
    """Colour of the sunlight, or of the moonlight at night."""
    lamps: Rgb
    ambient: Rgb
    """Colour of the ambient light."""
    headlight: float
    """Brightness of the light at the camera."""
    ceiling: float
    """Emission of ceilings, which no light from above reaches."""
    shades: float
    """Emission of lamp shades."""
    sky: Rgb | None
    """Colour of the sky; absent: the daytime sky, with the view from windows."""
    shadows: bool = True
    """Whether the sun casts shadows, which takes most of the rendering time."""


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
        name: One of `APPEARANCES`, or `random`.
        seed: Random seed for `random`; equal seeds give equal light.

    Raises:
        ValueError: No lighting has this name; the message lists the names.
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
    """Returns an MJCF text with attributes set in all elements that begin with a text, in place of their own."""

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
