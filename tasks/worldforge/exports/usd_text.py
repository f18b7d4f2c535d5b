"""Writes USD prims as text (`.usda`), without USD's own library."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .export_meshes import is_pictured, linear
from .export_scene import Matrix, Scene, Shape, texture_file, texture_name

_DIGITS = 6


@dataclass(slots=True)
class Prim:
    """A USD prim with attributes and children, written as `.usda` text."""

    kind: str
    """USD type of the prim: `Xform`, `Cube`, …"""
    name: str
    """Valid USD name of the prim, see `prim_name`."""
    schemas: list[str] = field(default_factory=list)
    """USD API schemas that are applied to the prim."""
    metadata: list[str] = field(default_factory=list)
    attributes: list[str] = field(default_factory=list)
    """USD attribute lines such as `double size = 2`."""
    children: list["Prim"] = field(default_factory=list)

    def set(self, kind: str, name: str, value: str) -> None:
        """Adds an attribute to the prim."""
        self.attributes.append(f"{kind} {name} = {value}")

    def lines(self, indent: str = "") -> list[str]:
        """Returns the prim and its children as indented text lines."""
        head = list(self.metadata)
        if self.schemas:
            head.insert(0, f"prepend apiSchemas = [{', '.join(map(quoted, self.schemas))}]")
        inner = indent + "    "
        made = [f'{indent}def {self.kind} "{self.name}"' + (" (" if head else "")]
        if head:
            made += [*(inner + line for line in head), f"{indent})"]
        made += [f"{indent}{{", *(inner + line for line in self.attributes)]
        for child in self.children:
            made += child.lines(inner)
        return [*made, f"{indent}}}"]


class PrimNames:
    """Gives unique names to the prims below one parent."""

    def __init__(self) -> None:
        self._given: set[str] = set()

    def take(self, text: str) -> str:
        """Returns a new unique prim name for a text: letters, digits and underscores."""
        first = name = prim_name(text)
        number = 1
        while name in self._given:
            number += 1
            name = f"{first}_{number}"
        self._given.add(name)
        return name


def prim_name(text: str) -> str:
    """Converts a text to a valid USD prim name."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return name if name and not name[0].isdigit() else f"_{name}"


def quoted(text: str) -> str:
    """Formats a string for USD, with quotes."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def number(value: float) -> str:
    """Formats a number for USD, with at most ten significant digits."""
    return f"{round(float(value), _DIGITS) + 0.0:.10g}"


def numbers(values: Iterable[float]) -> str:
    """Formats a vector for USD: `(1, 0.5, 0)`."""
    return f"({', '.join(map(number, values))})"


def vectors(rows: NDArray[np.float64], *, times: int = 1) -> str:
    """Formats an array of vectors for USD.

    Args:
        rows: Shape (vectors, components).
        times: Number of repetitions of each vector.
    """
    each = f"({', '.join(['%.10g'] * rows.shape[1])})"
    text = "\n".join([each] * len(rows)) % tuple((np.round(rows, _DIGITS) + 0.0).ravel().tolist())
    return f"[{', '.join([', '.join([row] * times) for row in text.splitlines()])}]"


def integers(values: Sequence[int]) -> str:
    """Formats an array of integers for USD."""
    return f"[{', '.join(map(str, values))}]"


def quaternion(rotation: Matrix) -> str:
    """Converts a rotation matrix to a USD quaternion: w, x, y, z."""
    # The largest of the four is worked out first: nothing near 0 divides.
    trace = float(np.trace(rotation))
    squares = np.array([trace, *(2 * np.diag(rotation) - trace)])
    largest = int(squares.argmax())
    across = [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    rows = np.zeros((4, 4))
    rows[0] = [1 + trace, *across]
    for axis in range(3):
        rows[axis + 1, 0] = across[axis]
        for other in range(3):
            rows[axis + 1, other + 1] = rotation[axis, other] + rotation[other, axis]
        rows[axis + 1, axis + 1] = 1 + 2 * rotation[axis, axis] - trace
    found = rows[largest]
    return numbers(found / np.linalg.norm(found))


_LOOKS = "Looks"
_ROUGHNESS = "0.85"


class Looks:
    """Collects USD materials while shapes are written; equal ones are stored once."""

    def __init__(self, scene: Scene, root: str) -> None:
        self.scope = Prim("Scope", _LOOKS)
        """USD prim that contains all materials."""
        self._scene = scene
        self._path = f"{root}/{_LOOKS}"
        self._names = PrimNames()
        self._paths: dict[str, str] = {}

    def bind(self, prim: Prim, shape: Shape) -> None:
        """Assigns a shape's material to its USD prim; adds the material to the scene if it is new."""
        picture = texture_file(self._scene, shape.material) if is_pictured(self._scene.model, shape) else None
        if picture is not None:
            key, color = texture_name(self._scene.model, shape.material), self._scene.model.mat_rgba[shape.material]
        else:
            key, color = "color " + " ".join(map(str, shape.color)), shape.color
        shown = numbers(linear(float(value)) for value in color[:3])
        if key not in self._paths:
            material = self._new(key)
            _surface(material, self._paths[key], shown, float(color[3]), picture)
        self._bind(prim, "material:binding", key)
        prim.set("color3f[]", "primvars:displayColor", f"[{shown}]")

    def bind_friction(self, prim: Prim, friction: float) -> None:
        """Assigns a friction coefficient to a colliding USD prim; adds its material to the scene if it is new."""
        key = f"friction {friction:g}"
        if key not in self._paths:
            material = self._new(key)
            # The second is NVIDIA's: of two that touch, the larger friction counts, as in MuJoCo.
            material.schemas += ["PhysicsMaterialAPI", "PhysxMaterialAPI"]
            material.set("float", "physics:dynamicFriction", number(friction))
            material.set("float", "physics:restitution", "0")
            material.set("float", "physics:staticFriction", number(friction))
            material.set("uniform token", "physxMaterial:frictionCombineMode", '"max"')
        self._bind(prim, "material:binding:physics", key)

    def _new(self, key: str) -> Prim:
        material = Prim("Material", self._names.take(key))
        self._paths[key] = f"{self._path}/{material.name}"
        self.scope.children.append(material)
        return material

    def _bind(self, prim: Prim, relation: str, key: str) -> None:
        if "MaterialBindingAPI" not in prim.schemas:
            prim.schemas.append("MaterialBindingAPI")
        prim.set("rel", relation, f"<{self._paths[key]}>")


def _surface(material: Prim, path: str, color: str, opacity: float, picture: str | None) -> None:
    material.set("token", "outputs:surface.connect", f"<{path}/Surface.outputs:surface>")
    surface = _shader("Surface", "UsdPreviewSurface")
    material.children.append(surface)
    if picture is None:
        surface.set("color3f", "inputs:diffuseColor", color)
    else:
        surface.set("color3f", "inputs:diffuseColor.connect", f"<{path}/Picture.outputs:rgb>")
        material.children += _picture(path, picture)
    surface.set("float", "inputs:metallic", "0")
    surface.set("float", "inputs:opacity", number(opacity))
    surface.set("float", "inputs:roughness", _ROUGHNESS)
    surface.attributes.append("token outputs:surface")


def _picture(path: str, picture: str) -> list[Prim]:
    shown, places = _shader("Picture", "UsdUVTexture"), _shader("Places", "UsdPrimvarReader_float2")
    shown.set("asset", "inputs:file", f"@./{picture}@")
    shown.set("token", "inputs:sourceColorSpace", '"sRGB"')
    shown.set("float2", "inputs:st.connect", f"<{path}/Places.outputs:result>")
    shown.set("token", "inputs:wrapS", '"repeat"')
    shown.set("token", "inputs:wrapT", '"repeat"')
    shown.attributes.append("float3 outputs:rgb")
    places.set("string", "inputs:varname", '"st"')
    places.attributes.append("float2 outputs:result")
    return [shown, places]


def _shader(name: str, kind: str) -> Prim:
    shader = Prim("Shader", name)
    shader.set("uniform token", "info:id", f'"{kind}"')
    return shader
