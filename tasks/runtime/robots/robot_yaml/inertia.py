"""Inertias of links in a URDF: finds physically impossible ones, and computes those of the links' shapes."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from .located_xml import Located

_SMALLEST = 1e-15
"""Minimum mass (kg) and moment of inertia (kg·m²) of moving bodies in MuJoCo (mjMINVAL)."""

_DENSITY_KGPM3 = 1000.0
"""MuJoCo's default density of shapes without a mass, in kg/m³."""

_BALL_M = 0.05
"""Radius in metres of the sphere whose inertia is suggested for a link without shapes."""

_THICKEN = 0.01
"""Fraction of the mean moment of inertia that is added for flat shapes, whose moments are exactly at the physical
limit, where rounding decides.
"""

_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_OVERRIDES = frozenset({"balanceinertia", "boundmass", "boundinertia", "inertiafromgeom"})
"""Settings of MuJoCo's compiler by which a URDF chooses itself how to handle impossible inertias."""

_SHELL = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
_SOLID = mujoco.mjtMeshInertia.mjMESH_INERTIA_LEGACY
"""MuJoCo's default way to compute the inertia of a mesh: that of the enclosed volume."""

_MOST_TOLD = 4

MakeSpec = Callable[[ET.Element], mujoco.MjSpec]
"""Function that makes a MuJoCo model of a URDF whose mesh files have been found."""


@dataclass(frozen=True)
class Inertia:
    """Mass (kg), moments of inertia (kg m², 3 × 3) and centre of mass (m) of a robot's link."""

    mass_kg: float
    moments: NDArray[np.float64]
    """Inertia matrix about the centre of mass, along the link's axes, in kg·m²."""

    centre_m: NDArray[np.float64]
    """Centre of mass in the link's frame, in metres."""

    def element(self) -> ET.Element:
        """Returns the URDF element `<inertial>` with these values."""
        inertial = ET.Element("inertial")
        ET.SubElement(inertial, "origin", xyz=" ".join(f"{each:.6g}" for each in self.centre_m.tolist()))
        ET.SubElement(inertial, "mass", value=f"{self.mass_kg:.6g}")
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = self.moments.tolist()
        values = dict(zip(_MOMENTS, (xx, yy, zz, xy, xz, yz), strict=True))
        ET.SubElement(inertial, "inertia", {name: f"{value:.6g}" for name, value in values.items()})
        return inertial

    def __str__(self) -> str:
        """Returns the `<inertial>` element in one line."""
        return ET.tostring(self.element(), encoding="unicode").replace(" />", "/>")


@dataclass(frozen=True)
class Problem:
    """A robot's link whose inertia is physically impossible: line, text, and the inertia to write instead."""

    link: Located
    line: int
    text: str
    """Values of the impossible inertia and the error, as text."""

    source: str
    """Source of the suggested inertia, as text."""

    suggestion: Inertia
    by_setting: Inertia | None
    """Inertia that the link gets if the setting asks for a replacement; None: it has no shapes to compute one from, and
    has to move.
    """

    def __str__(self) -> str:
        """Describes the problem, and the values to write instead."""
        name = self.link.get("name")
        setting = ", or set impossible_inertia: from_geometry in robot.yaml" if self.by_setting is not None else ""
        return f"link {name!r}: {self.text}; {self.source} {self.suggestion}: write that or what was measured{setting}"


def find_problems(robot: Located, make_spec: MakeSpec) -> list[Problem]:
    """Finds links of a URDF with impossible inertias, which MuJoCo refuses or silently changes.

    Args:
        robot: Document of the URDF.
        make_spec: Function that makes a MuJoCo model of a URDF.
    """
    compiler = robot.find("mujoco/compiler")
    if compiler is not None and not _OVERRIDES.isdisjoint(compiler.attrib):
        return []
    links = [each for each in robot.iter("link") if isinstance(each, Located)]
    texts = {link.get("name"): text for link in links if (text := _impossible(link))}
    problems: list[Problem] = []
    for group, joint in _moving_groups(robot, links):
        bad = [link for link in group if link.get("name") in texts]
        # The others carry links that are fixed to them, which may then be points.
        is_carried = any(link not in bad and _can_move(link) for link in group)
        if not bad and not is_carried:
            bad = [next((each for each in group if _shapes(each)), group[0])]
            texts[bad[0].get("name")] = _massless(bad[0], group[0], joint)
        for link in bad:
            line, text = texts[link.get("name")]
            problems.append(_problem(link, line, text, make_spec, is_carried=is_carried))
    return sorted(problems, key=lambda problem: problem.line)


def _problem(link: Located, line: int, text: str, make_spec: MakeSpec, *, is_carried: bool) -> Problem:
    mass_kg = _mass_kg(link)
    if (shapes := _of_shapes(link, make_spec)) is not None:
        factor = mass_kg / shapes.mass_kg if mass_kg else 1.0
        found = Inertia(shapes.mass_kg * factor, shapes.moments * factor, shapes.centre_m)
        return Problem(link, line, text, "its shapes have", found, found)
    ball_kg = mass_kg or _DENSITY_KGPM3 * 4 / 3 * math.pi * _BALL_M**3
    ball = Inertia(ball_kg, np.eye(3) * 0.4 * ball_kg * _BALL_M**2, np.zeros(3))
    point = Inertia(mass_kg, np.zeros((3, 3)), np.zeros(3)) if is_carried else None
    return Problem(link, line, text, f"a ball of {_BALL_M:g} m radius has", ball, point)


def _mass_kg(link: Located) -> float:
    """Returns the mass of a link in kg; 0 if it has none, or an impossible one."""
    mass = link.find("inertial/mass")
    try:
        mass_kg = float(mass.get("value", "")) if mass is not None else 0.0
    except ValueError:
        return 0.0
    return mass_kg if math.isfinite(mass_kg) and mass_kg > 0 else 0.0


def told(problems: list[Problem], path: object) -> str:
    """Returns text about impossible inertias of links, with the URDF's lines; of many, only the first are named.

    Args:
        problems: Links with impossible inertias.
        path: Path of the URDF.
    """
    texts = [f"{path}:{each.line}: {each}" if index else str(each) for index, each in enumerate(problems)]
    more = f"; and {len(texts) - _MOST_TOLD} links more" if len(texts) > _MOST_TOLD else ""
    return "; ".join(texts[:_MOST_TOLD]) + more


def replace_inertial(problem: Problem) -> None:
    """Replaces a link's inertia in the URDF by the suggested one: that of its shapes, or of a point mass."""
    assert problem.by_setting is not None
    for old in problem.link.findall("inertial"):
        problem.link.remove(old)
    problem.link.insert(0, problem.by_setting.element())


def _impossible(link: Located) -> tuple[int, str] | None:
    """Returns line and text of a link's physically impossible mass or inertia.

    None: both are possible or absent, or MuJoCo's importer reports them.
    """
    mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
    if mass is None or inertia is None:
        return None
    try:
        mass_kg = float(mass.get("value", ""))
        values = [float(inertia.get(name, "")) for name in _MOMENTS]
    except ValueError:
        return None
    for element, text in ((mass, _impossible_mass(mass_kg)), (inertia, _impossible_moments(values))):
        if text is not None:
            return element.line if isinstance(element, Located) else link.line, text
    return None


def _impossible_mass(mass_kg: float) -> str | None:
    if math.isfinite(mass_kg) and mass_kg >= 0:
        return None
    return f"its mass is {mass_kg:g} kg, which no body has"


def _impossible_moments(values: list[float]) -> str | None:
    if not any(values):
        return None  # a point; whether it can move is looked at with what is fixed to it
    written = " ".join(f"{name}={value:g}" for name, value in zip(_MOMENTS, values, strict=True))
    if not all(map(math.isfinite, values)):
        return f"its inertia is {written}, which no body has"
    xx, yy, zz, xy, xz, yz = values
    principal = sorted(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist())
    moments = ", ".join(f"{value:.3g}" for value in principal)
    if principal[0] <= 0:
        return f"its inertia {written} has the principal moments {moments} kg·m², and each has to be above 0"
    if principal[0] + principal[1] < principal[2]:
        return (
            f"its inertia {written} has the principal moments {moments} kg·m², and no body has one that is larger than "
            "the other two together"
        )
    return None


def _massless(link: Located, first: Located, joint: Located | None) -> tuple[int, str]:
    """Returns line and text of the error about rigidly connected links that move and have no mass."""
    inertial, mass = link.find("inertial"), link.find("inertial/mass")
    said = f"a mass of {mass.get('value')} kg without inertia" if mass is not None else "no mass"
    how = f"moves on joint {joint.get('name')!r}" if joint is not None else "is what all others hang on"
    who = "and" if link is first else f"and is fixed to {first.get('name')!r}, which"
    return inertial.line if isinstance(inertial, Located) else link.line, f"it has {said}, {who} {how}"


def _moving_groups(robot: Located, links: list[Located]) -> Iterator[tuple[list[Located], Located | None]]:
    """Yields groups of rigidly connected links, and the joint that moves each group; None: it moves freely."""
    by_name = {link.get("name", ""): link for link in links}
    joints = [each for each in robot.findall("joint") if isinstance(each, Located)]
    children: dict[str, list[str]] = {}
    moving: dict[str, Located | None] = dict.fromkeys(by_name)
    for joint in joints:
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None or child.get("link") not in by_name:
            continue  # MuJoCo says so
        name = child.get("link", "")
        moving.pop(name, None)
        if joint.get("type") == "fixed":
            children.setdefault(parent.get("link", ""), []).append(name)
        else:
            moving[name] = joint
    for first, joint in moving.items():
        yield [by_name[name] for name in _fixed_to(first, children)], joint


def _fixed_to(first: str, children: Mapping[str, list[str]]) -> list[str]:
    names = [first]
    for name in names:
        names.extend(child for child in children.get(name, ()) if child not in names)
    return names


def _can_move(link: Located) -> bool:
    """Returns whether a link's mass and inertia are large enough for MuJoCo to let it move.

    A link without `<inertial>` can move if it has collision shapes, from which MuJoCo computes both. Missing or
    unreadable values count as large enough: MuJoCo's importer reports unreadable ones with their line.
    """
    inertial = link.find("inertial")
    if inertial is None:
        return bool(link.findall("collision"))
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    try:
        values = [float(inertia.get(name, "")) for name in _MOMENTS[:3]] if inertia is not None else [1.0]
        return min(float(mass.get("value", "")) if mass is not None else 1.0, *values) >= _SMALLEST
    except ValueError:
        return True


def _shapes(link: Located) -> list[ET.Element]:
    """Returns the shapes from which a link's inertia can be computed: the collision shapes, else the visual ones."""
    return link.findall("collision") or link.findall("visual")


def _of_shapes(link: Located, make_spec: MakeSpec) -> Inertia | None:
    """Computes mass and inertia of a link's shapes at MuJoCo's default density; None if no shape has a volume.

    Meshes are taken for solid, or for shells if they are not closed; flat inertias are thickened.
    """
    alone = ET.Element("robot", name="alone")
    body = ET.SubElement(alone, "link", name="link")
    for shape in _shapes(link):
        ET.SubElement(body, "collision").extend(list(shape))
    for of_shells in (False, True):
        try:
            spec = make_spec(alone)
            for geom in spec.geoms:
                geom.contype = geom.conaffinity = 0  # so that flat meshes do
            for mesh in spec.meshes:  # those that are only drawn are shells, which say nothing of a body's mass
                mesh.inertia = _SHELL if of_shells else _SOLID
            model = spec.compile()
        except ValueError:
            continue
        mass_kg, principal = float(model.body_mass[-1]), np.asarray(model.body_inertia[-1], dtype=float)
        if mass_kg < _SMALLEST:
            return None
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, model.body_iquat[-1])
        if 2 * principal.max() >= principal.sum() * (1 - 1e-3) or principal.min() < _SMALLEST:
            principal = principal + _THICKEN * principal.mean()
        turned = axes.reshape(3, 3)
        return Inertia(mass_kg, turned @ np.diag(principal) @ turned.T, np.array(model.body_ipos[-1], dtype=float))
    return None
