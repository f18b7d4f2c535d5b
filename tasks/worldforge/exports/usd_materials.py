"""Materials of a USD stage: what shapes look like, and how they grip."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from .export_scene import Scene, Shape, texture_file, texture_name
from .export_surfaces import is_pictured, linear
from .usd_text import Prim, PrimNames, number, numbers

_LOOKS = "Looks"
_ROUGHNESS = "0.85"


class Looks:
    """Collects materials while shapes are written; equal ones are stored once."""

    def __init__(self, scene: Scene, root: str) -> None:
        self.scope = Prim("Scope", _LOOKS)
        """The prim that has them."""
        self._scene = scene
        self._path = f"{root}/{_LOOKS}"
        self._names = PrimNames()
        self._paths: dict[str, str] = {}

    def bind(self, prim: Prim, shape: Shape) -> None:
        """Gives a prim the look of a shape."""
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

    def grip(self, prim: Prim, friction: float) -> None:
        """Gives a prim that collides its friction."""
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
