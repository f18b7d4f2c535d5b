"""Reads the `<state>` element that Gazebo's window saved in a world: poses, scales, and deleted models."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

from .frames import own_pose
from .sdf_types import Pose, SdfError
from .xml_files import numbers_of, place


@dataclass(frozen=True, slots=True)
class SavedModel:
    """Pose and scale of a model in the saved state of a Gazebo world."""

    pose: Pose | None
    scale: tuple[float, float, float]


@dataclass(slots=True)
class SavedState:
    """Saved state (`<state>`) of a Gazebo world: poses of models and links."""

    models: dict[str, SavedModel] = field(default_factory=dict)
    links: dict[str, Pose] = field(default_factory=dict)
    joints: set[str] = field(default_factory=set)
    """Paths of joints with a saved angle."""
    lights: dict[str, Pose] = field(default_factory=dict)
    deleted: set[str] = field(default_factory=set)


def read_saved_state(world: ET.Element) -> SavedState:
    """Reads the saved state of a Gazebo world; empty if the file has none.

    Raises:
        SdfError: A pose in it is none.
    """
    found = SavedState()
    for state in world.findall("state"):
        for model in state.findall("model"):
            _add(model, "", found)
        for light in state.findall("light"):
            if light.find("pose") is not None:
                found.lights[light.get("name", "")] = own_pose(light)
        found.deleted |= {(name.text or "").strip() for name in state.findall("deletions/name")}
    return found


def _add(model: ET.Element, prefix: str, found: SavedState) -> None:
    path = prefix + model.get("name", "")
    x, y, z = numbers_of(model.find("scale"), 3, (1.0, 1.0, 1.0))
    if not min(x, y, z) > 0:
        raise SdfError(
            f"{place(model)}: the saved scale of {path} is {x:g} {y:g} {z:g}; numbers above 0 would be right"
        )
    found.models[path] = SavedModel(own_pose(model) if model.find("pose") is not None else None, (x, y, z))
    for link in model.findall("link"):
        if link.find("pose") is not None:
            found.links[f"{path}::{link.get('name', '')}"] = own_pose(link)
    found.joints |= {f"{path}::{joint.get('name', '')}" for joint in model.findall("joint")}
    for inner in model.findall("model"):
        _add(inner, f"{path}::", found)
