"""A world in SDF: the building, and furniture and objects as models that worlds share."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from math import tan

import numpy as np

from .export_scene import BUILDING, Scene
from .sdf import SDF_VERSION, model_files, pose_text, xml_text
from .sdf_models import SharedModels

_FIELD_OF_VIEW_RAD = 1.047
"""Field of view of the camera of Gazebo's window, in radians."""


@dataclass(frozen=True, slots=True)
class SdfWorld:
    """Files that belong to one world alone; the shared models have the others."""

    world: str
    """The world file."""
    building: dict[str, str]
    """The files of its building's model."""
    models: tuple[str, ...]
    """Names of the shared models in it, each once."""


def sdf_world(scene: Scene, name: str, shared: SharedModels) -> SdfWorld:
    """Writes a world; its building becomes the model of the world's own name.

    Args:
        scene: the world.
        name: its name in archives.
        shared: gets the models that are not in it yet.
    """
    root = ET.Element("sdf", version=SDF_VERSION)
    world = ET.SubElement(root, "world", name=name)
    _add(world, "gravity", "0 0 -9.81")
    _physics(world)
    _light(world)
    _window(world, scene)
    building, *others = scene.things
    _include(world, BUILDING, name, "0 0 0 0 0 0")
    used: list[str] = []
    for thing in others:
        model = shared.add(thing, scene)
        used.append(model)
        _include(world, thing.name, model, pose_text(thing.position, thing.rotation))
    return SdfWorld(xml_text(root), model_files(building, name, scene), tuple(dict.fromkeys(used)))


def _add(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text


def _include(world: ET.Element, name: str, model: str, pose: str) -> None:
    include = ET.SubElement(world, "include")
    _add(include, "name", name)
    _add(include, "uri", f"model://{model}")
    _add(include, "pose", pose)


def _physics(world: ET.Element) -> None:
    physics = ET.SubElement(world, "physics", name="default_physics", default="1", type="ode")
    _add(physics, "max_step_size", "0.001")
    _add(physics, "real_time_factor", "1")
    _add(physics, "real_time_update_rate", "1000")


def _light(world: ET.Element) -> None:
    scene = ET.SubElement(world, "scene")
    _add(scene, "ambient", "0.5 0.5 0.5 1")
    _add(scene, "background", "0.75 0.82 0.88 1")
    _add(scene, "shadows", "true")
    sun = ET.SubElement(world, "light", name="sun", type="directional")
    _add(sun, "cast_shadows", "true")
    _add(sun, "pose", "0 0 10 0 0 0")
    _add(sun, "diffuse", "0.7 0.7 0.68 1")
    _add(sun, "specular", "0.1 0.1 0.1 1")
    _add(sun, "direction", "-0.3 0.4 -0.87")


def _window(world: ET.Element, scene: Scene) -> None:
    """Gazebo's window looks at the whole building from the south."""
    corners = np.array(scene.world.floorplan.footprint)
    x, y = (corners.max(axis=0) + corners.min(axis=0)) / 2
    width, depth = corners.max(axis=0) - corners.min(axis=0)
    distance = max(width, depth * 1.4) / 2 / tan(_FIELD_OF_VIEW_RAD / 2) + scene.world.floorplan.ceiling_height_m
    tilt = 1.1
    camera = ET.SubElement(ET.SubElement(world, "gui"), "camera", name="user_camera")
    position = np.array([x, y - distance * np.cos(tilt), distance * np.sin(tilt)])
    _add(camera, "pose", f"{position[0]:.3f} {position[1]:.3f} {position[2]:.3f} 0 {tilt} 1.570796")
