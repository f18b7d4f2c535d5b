"""Resolves SDF frames of a model or world: `relative_to`, `attached_to`, `placement_frame` and names with `::`."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import radians

import numpy as np

from .sdf_types import Pose, SdfError, euler_matrix, identity
from .xml_files import numbers_of, place

MODEL_FRAME = "__model__"


def own_pose(element: ET.Element) -> Pose:
    """Returns the pose in an SDF element's `<pose>`, in the frame that it is relative to.

    Raises:
        SdfError: The text is not a pose.
    """
    pose = element.find("pose")
    if pose is None:
        return identity()
    if pose.get("rotation_format") == "quat_xyzw":
        x, y, z, qx, qy, qz, qw = numbers_of(pose, 7, (0.0,) * 6 + (1.0,))
        return Pose(np.array([x, y, z]), _quaternion_matrix(qw, qx, qy, qz))
    values = numbers_of(pose, 6, (0.0,) * 6)
    angles = values[3:]
    if pose.get("degrees", "").lower() in ("true", "1"):
        angles = tuple(radians(angle) for angle in angles)
    return Pose(np.array(values[:3]), euler_matrix(angles[0], angles[1], angles[2]))


def relative_to(element: ET.Element) -> str:
    """Returns the name of the frame that an SDF element's pose is relative to; empty for the default."""
    pose = element.find("pose")
    if pose is None:
        return ""
    # SDF 1.5 and 1.6 called it `frame`.
    return pose.get("relative_to", "") or pose.get("frame", "")


def _quaternion_matrix(w: float, x: float, y: float, z: float) -> np.ndarray:
    norm = np.sqrt(w * w + x * x + y * y + z * z)
    if norm < 1e-9:
        return np.eye(3)
    w, x, y, z = (part / norm for part in (w, x, y, z))
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


@dataclass(slots=True)
class Scope:
    """The named frames of one SDF model or world."""

    element: ET.Element
    nested: Mapping[str, "Scope"] = field(default_factory=dict)
    """Frame scopes of nested SDF models, by name."""
    placement_frame: str = ""
    pose_of_model: Pose | None = None
    """Pose that an `<include>` gives the model in place of its own."""
    relative_to: str | None = None
    """Frame that `pose_of_model` is relative to."""
    merged: tuple["Scope", ...] = ()
    """Frame scopes of included models that are merged into this one (`<include merge>`)."""
    _frames: dict[str, ET.Element] | None = None
    _known: dict[str, Pose] = field(default_factory=dict)
    _resolving: set[str] = field(default_factory=set)

    def resolve(self, name: str) -> Pose:
        """Returns the pose of a named frame in the model's frame.

        Args:
            name: Name of a link, frame, joint or model in it; empty: its own frame.

        Raises:
            SdfError: The model has no frame of this name, or frames are relative to each other in a circle.
        """
        if name in ("", MODEL_FRAME, "world"):
            return identity()
        if name in self._known:
            return self._known[name]
        if name in self._resolving:
            raise SdfError(f"{place(self.element)}: the frame {name!r} is relative to itself")
        self._resolving.add(name)
        try:
            found = self._resolved(name)
        finally:
            self._resolving.discard(name)
        self._known[name] = found
        return found

    def _resolved(self, name: str) -> Pose:
        first, _, rest = name.partition("::")
        if first in self.nested:
            placed = self.model_pose(first)
            return placed @ self.nested[first].resolve(rest) if rest else placed
        element = self._element(name)
        if element is None:
            for other in self.merged:
                if other.has(name):
                    return self.pose_of(other) @ other.resolve(name)
            there = ", ".join([*self._all(), *self.nested][:12])
            raise SdfError(f"{place(self.element)}: there is no frame {name!r} in it; it has {there or 'none'}")
        return self.pose_of_part(element)

    def pose_of_part(self, element: ET.Element) -> Pose:
        """Returns the pose of a link, frame or joint of the model in its frame; a joint may be called like a link.

        Raises:
            SdfError: The frame that it is relative to is none, or is relative to itself.
        """
        base = relative_to(element)
        if not base and element.tag == "frame":
            base = element.get("attached_to", "")
        if not base and element.tag == "joint":
            child = element.find("child")
            base = (child.text or "").strip() if child is not None else ""
            base = "" if base == "world" else base
        return self.resolve(base) @ own_pose(element)

    def has(self, name: str) -> bool:
        """Whether the model has a frame of this name."""
        own = name.partition("::")[0] in self.nested or self._element(name) is not None
        return own or any(other.has(name) for other in self.merged)

    def link_of(self, name: str) -> str:
        """Returns the link, by its path in the model, that a frame is fixed to; the name itself if that is a link.

        Args:
            name: Name of a link, frame, joint or model in it, as in a joint's `<parent>` or `<child>`.
        """
        at, seen = name, set[str]()
        while at not in seen:
            seen.add(at)
            first, _, rest = at.partition("::")
            if first in self.nested:
                return f"{first}::{self.nested[first].link_of(rest or MODEL_FRAME)}"
            if at == MODEL_FRAME:
                own = self.element.find("link")
                at = self.element.get("canonical_link") or (own.get("name", "") if own is not None else name)
                continue
            element = self._element(at)
            if element is None:
                return next((other.link_of(at) for other in self.merged if other.has(at)), at)
            if element.tag == "link":
                return at
            attached = (
                element.get("attached_to", "") if element.tag == "frame" else element.findtext("child", "").strip()
            )
            at = attached or MODEL_FRAME
        return name

    def model_pose(self, name: str) -> Pose:
        """Returns the pose of a nested SDF model; KeyError if there is none of that name."""
        return self.pose_of(self.nested[name])

    def pose_of(self, model: "Scope") -> Pose:
        """Returns the pose of a nested model's frame in this scope's frame."""
        stated = model.pose_of_model if model.pose_of_model is not None else own_pose(model.element)
        base = model.relative_to if model.relative_to is not None else relative_to(model.element)
        placed = model.resolve(model.placement_frame)
        return self.resolve(base) @ stated @ placed.inverse()

    def _all(self) -> dict[str, ET.Element]:
        if self._frames is None:
            # Links come last, as they count where older files call a joint like its link.
            self._frames = {
                child.get("name", ""): child
                for tag in ("joint", "frame", "link")
                for child in self.element.findall(tag)
            }
        return self._frames

    def _element(self, name: str) -> ET.Element | None:
        return self._all().get(name)
