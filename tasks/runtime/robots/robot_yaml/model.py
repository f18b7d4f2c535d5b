"""Model of a robot that has a `robot.yaml`: its MJCF, URDF or SDF, with the additions of `robot.yaml`."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ..robot import add_camera, add_sensors
from .located_xml import parse_located
from .mapping import alternatives, invalid
from .robot_files import check_inside, similar_file
from .sdf_model import read_sdf
from .shape import AddedActuator, RobotModel
from .urdf import UrdfReading, check_expanded, read_urdf, refused

_TEXTURE_TAGS = frozenset({"texture"})
_MODEL_TAGS = frozenset({"include", "model"})
_File = tuple[str, Path]
"""Name of a file as it is written, and its path."""


def load_model(path: Path, root: Path, reading: UrdfReading | None = None) -> mujoco.MjSpec:
    """Loads a robot's MJCF, URDF or SDF model file, and returns its specification, which is not compiled yet.

    Without a state of reading, a URDF or SDF is read with a new one.

    Args:
        path: Path of the MJCF, URDF or SDF file.
        root: Folder that has to contain all files of the robot.
        reading: State of reading a URDF or SDF.

    Raises:
        LaunchError: The file is not a robot model, or names files outside the folder.
    """
    check_inside(path, path, root, str(path))
    if not path.is_file():
        near = similar_file(path.parent, path.name, root)
        hint = f"did you mean {near!r}? Give" if near else "give"
        raise invalid(
            path, f"there is no such file; {hint} the robot's MJCF, URDF or SDF, relative to the mapping file"
        )
    element = parse_located(path)
    if element.tag == "robot":
        return read_urdf(element, path, root, reading)
    if element.tag == "sdf":
        return read_sdf(path, root, reading or UrdfReading())
    if reading is not None and reading.from_geometry:
        raise invalid(
            path,
            'impossible_inertia: it is for URDF and SDF; in MJCF <compiler inertiafromgeom="true"/> or '
            '<compiler balanceinertia="true"/> says what to do',
        )
    check_expanded(element, path)
    for name, file in _files_of(element, path, path.parent):
        check_inside(path, file, root, name)
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as cause:
        raise refused(path, cause, "MuJoCo cannot read it", _meant(element, path, root)) from cause


def _meant(element: ET.Element, path: Path, root: Path) -> str:
    """Makes the end of an error message: files with names similar to those of missing files that an MJCF names."""
    hints: list[str] = []
    for name, file in _files_of(element, path, path.parent) if element.tag not in ("robot", "sdf") else ():
        near = None if file.is_file() else similar_file(path.parent, str(file.relative_to(path.parent)), root)
        if near is not None:
            hints.append(f"; there is no file {name!r}, did you mean {near!r} in the folder of {path.name}?")
    return "".join(dict.fromkeys(hints))


def _files_of(element: ET.Element, path: Path, folder: Path, seen: frozenset[Path] = frozenset()) -> Iterator[_File]:
    """Yields every file that an MJCF and its includes name, as written and as a path.

    Raises `LaunchError` if a name is absolute, or a file includes itself.

    Args:
        element: Root element of the MJCF.
        path: Its file.
        folder: Folder to which names are relative: that of the main file.
        seen: Files in which this one is included.
    """
    compilers = list(element.iter("compiler"))
    meshes, textures = (
        next((each.get(key) or each.get("assetdir") for each in compilers if each.get(key) or each.get("assetdir")), "")
        for key in ("meshdir", "texturedir")
    )
    for each in element.iter():
        for key, name in each.attrib.items():
            if not key.startswith("file") or not name:
                continue
            if Path(name).is_absolute() or name.startswith("~"):
                raise invalid(path, f"the file {name!r} is absolute; files are relative to the model")
            inside = "" if each.tag in _MODEL_TAGS else textures if each.tag in _TEXTURE_TAGS else meshes
            file = folder / str(inside) / name
            yield name, file
            if each.tag in _MODEL_TAGS and file.suffix == ".xml" and file.is_file():
                if file.resolve() in seen:
                    raise invalid(path, f"the file {name!r} includes itself")
                within = seen | {file.resolve()}
                yield from _files_of(
                    parse_located(file), file, folder if each.tag == "include" else file.parent, within
                )


FREE_JOINT = "base_free_joint"
FOOTPRINT = "base_footprint_mark"
FOLLOW_CAMERA = "follow"

_SLIDING_FRICTION = (0.01, 0.005, 0.0001)
_FREE = mujoco.mjtJoint.mjJNT_FREE
_SINGLE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_SCOUT_RADIUS_M = 0.17
"""Radius of Scout, in metres; follow cameras of other robots are scaled from Scout's."""

_MAX_FOLLOW_SCALE = 1.6
"""Maximum scale of follow cameras: from more than about a metre away they are mostly behind the walls of rooms."""


@dataclass(frozen=True)
class RobotFiles:
    """Paths of a robot's files: its `robot.yaml`, its model, and the root outside which no file may be."""

    mapping: Path
    """Path of `robot.yaml`, or another name for messages."""

    model: Path
    """Path of the MJCF, URDF or SDF model."""

    root: Path
    """Folder that has to contain all files of the robot."""


class ModelBuilder:
    """Builds MuJoCo models of one robot from its files; defects of these raise `LaunchError`."""

    def __init__(self, mapping: RobotModel, files: RobotFiles) -> None:
        self._mapping, self._files = mapping, files
        self.where = files.mapping.name
        self.reading = UrdfReading(from_geometry=mapping.impossible_inertia == "from_geometry")
        self.carrier = mapping.base
        """Name of the body that moves over the floor; differs from the base if the base's own joints are below it."""

        self.footprint_z_m = -mapping.spawn.height_m
        """Height of the floor in the carrier's frame at the start, in metres."""

        self.keeps_joints = mapping.drive.kind == "velocity" and mapping.drive.frame == "world"
        """Whether the robot's own joints move it; otherwise it gets a free joint."""

    def build(self) -> mujoco.MjSpec:
        """Returns the robot's model with the additions of its `robot.yaml`.

        Raises:
            LaunchError: A file or a name is wrong.
        """
        spec = load_model(self._files.model, self._files.root, self.reading)
        base = self._keep_robot_only(spec)
        for key in list(spec.keys):
            spec.delete(key)  # it is as long as all joints of the file, which are not all here
        self._free(spec, base)
        self._add_actuators(spec)
        self._add_sensors(spec)
        for index, name in enumerate(self._mapping.sliding):
            part = self.find([*spec.geoms, *spec.bodies], name, f"sliding[{index}]", "bodies and geoms")
            for geom in part.geoms if isinstance(part, mujoco.MjsBody) else [part]:
                # By priority: of two geoms MuJoCo would take the larger friction, which is the floor's.
                geom.friction, geom.priority = _SLIDING_FRICTION, 1
        self._add_cameras(spec, base)
        carrier = self.find(spec.bodies, self.carrier, "base", "bodies")
        carrier.add_body(name=FOOTPRINT, pos=[0, 0, self.footprint_z_m])
        return spec

    def compile(self) -> mujoco.MjModel:
        """Compiles and returns the robot's model without a world; unusable visual meshes are left out.

        Raises:
            LaunchError: A file or a name is wrong, or MuJoCo cannot compile it.
        """
        spec = self.build()
        try:
            return spec.compile()
        except ValueError as cause:
            if self.reading.leave_out_unusable(self._files.model):
                return self.compile()
            hint = _meant(parse_located(self._files.model), self._files.model, self._files.root)
            raise refused(self._files.model, cause, "MuJoCo cannot make a model of it", hint) from cause

    def find(self, parts: Iterable[Any], name: str, field: str, what: str) -> Any:
        """Returns the part with a name among bodies, geoms, joints or other parts of the robot's model.

        The body `world` is not found.

        Raises:
            LaunchError: The model has no such part; the message names the field and the parts that the model has.
        """
        by_name = {part.name: part for part in parts if part.name != "world"}
        if name not in by_name:
            hint = alternatives(name, by_name, what, field)
            raise invalid(self.where, f"{field}: {self._files.model.name} has no {name!r} among its {what}; {hint}")
        return by_name[name]

    def keyframe(self) -> dict[str, float]:
        """Returns the joint positions, by joint, in the keyframe that `robot.yaml` names; empty if it names none.

        Raises `LaunchError` if the model has no such keyframe.
        """
        if self._mapping.spawn.keyframe is None:
            return {}
        spec = load_model(self._files.model, self._files.root, self.reading)
        key = self.find(spec.keys, self._mapping.spawn.keyframe, "spawn.keyframe", "keyframes").name
        model = spec.compile()
        joints = [model.joint(index) for index in range(model.njnt)]
        qpos = model.key(key).qpos
        return {
            joint.name: float(qpos[joint.qposadr[0]])
            for joint in joints
            if joint.name and int(model.jnt_type[joint.id]) in _SINGLE
        }

    def _keep_robot_only(self, spec: mujoco.MjSpec) -> mujoco.MjsBody:
        """Deletes everything that does not belong to the robot (floors, lights) from its model, and returns its base.

        Raises `LaunchError` if the base is missing or hangs on another body.
        """
        base = self.find(spec.bodies, self._mapping.base, "base", "bodies")
        if base.parent.name != "world":
            root = base
            while root.parent.name != "world":
                root = root.parent
            raise invalid(self.where, f"base: {base.name!r} hangs on other bodies; name the outermost, {root.name!r}")
        world = spec.worldbody
        for part in [*world.bodies, *world.geoms, *world.lights, *world.cameras, *world.sites]:
            if part is not base and not (isinstance(part, type(base)) and part.name == base.name):
                spec.delete(part)
        return base

    def _free(self, spec: mujoco.MjSpec, base: mujoco.MjsBody) -> None:
        for joint in list(base.joints):
            if joint.type == _FREE:
                spec.delete(joint)
        if self.keeps_joints:
            base.pos = [0, 0, self._mapping.spawn.height_m]
            return
        if base.joints:
            own = ", ".join(repr(joint.name) for joint in base.joints)
            raise invalid(
                self.where,
                f"base: {self._mapping.base!r} has joints of its own ({own}), so that it cannot move freely; name the "
                "body that hangs on no joint, or use drive: {kind: velocity, frame: world} if they move the robot",
            )
        base.add_freejoint(name=FREE_JOINT)

    def _add_actuators(self, spec: mujoco.MjSpec) -> None:
        for index, own in enumerate(spec.actuators):
            own.name = own.name or f"actuator_{index}"
        for index, wanted in enumerate(self._mapping.actuators):
            joint = self.find(spec.joints, wanted.joint, f"actuators[{index}].joint", "joints")
            name = wanted.name or wanted.joint
            if any(each.name == name for each in spec.actuators):
                field = f"actuators[{index}]"
                raise invalid(self.where, f"{field}: there is an actuator {name!r} already; give this one another name")
            if wanted.armature is not None:
                joint.armature = wanted.armature
            _set(spec.add_actuator(name=name, target=wanted.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT), wanted)

    def _add_sensors(self, spec: mujoco.MjSpec) -> None:
        for sensor in self._mapping.sensors.of_kinds():
            if sensor.at is None:
                continue
            site = next((each.name for each in spec.sites if each.name == sensor.at), None)
            if site is None:
                places = [*spec.bodies, *spec.sites]
                body = self.find(places, sensor.at, f"sensors.{sensor.name}.at", "bodies and sites")
                site = body.add_site(name=f"{sensor.at}_{sensor.name}_site", group=5).name
            add_sensors(spec, site, dict(zip(sensor.own_names, sensor.parts.values(), strict=True)))

    def _add_cameras(self, spec: mujoco.MjSpec, base: mujoco.MjsBody) -> None:
        for index, wanted in enumerate(self._mapping.sensors.cameras):
            body = self.find(spec.bodies, wanted.at, f"sensors.cameras[{index}].at", "bodies")
            add_camera(body, wanted.name, (0, 0, 0), (0, 0, 1), wanted.fovy_deg)
        if self._mapping.video_camera is None and all(each.name != FOLLOW_CAMERA for each in spec.cameras):
            scale = min(max(1.0, self._mapping.footprint.radius_m / _SCOUT_RADIUS_M), _MAX_FOLLOW_SCALE)
            place = (-0.75 * scale, 0.0, 0.95 * scale - self._mapping.spawn.height_m)
            add_camera(base, FOLLOW_CAMERA, place, (0.72, 0, 0.69), 62.0)


def options_for_world(spec: mujoco.MjSpec, world: mujoco.MjSpec) -> list[str]:
    """Replaces a robot's physics options by those of its world.

    Returns:
        The robot's options that are lost, as `name=robot's value (value of the world)`.
    """
    untouched, dropped = mujoco.MjSpec().option, []
    for name in dir(spec.option):
        if name.startswith("_"):
            continue
        own, theirs = getattr(spec.option, name), getattr(world.option, name)
        if not np.array_equal(own, getattr(untouched, name)) and not np.array_equal(own, theirs):
            dropped.append(f"{name}={_shown(own)} ({_shown(theirs)})")
        setattr(spec.option, name, theirs)
    return dropped


def _shown(value: Any) -> str:
    return " ".join(f"{each:g}" for each in np.atleast_1d(value).astype(float).tolist())


def _set(actuator: Any, wanted: AddedActuator) -> None:
    if wanted.kind == "velocity":
        actuator.set_to_velocity(kv=wanted.gain)
    elif wanted.kind == "position":
        actuator.set_to_position(kp=wanted.gain, kv=wanted.damping)
    else:
        actuator.set_to_motor()
        actuator.gear = [wanted.gain, 0, 0, 0, 0, 0]
    if wanted.force_limit is not None:
        actuator.forcelimited, actuator.forcerange = True, [-wanted.force_limit, wanted.force_limit]
    if wanted.range is not None:
        actuator.ctrllimited, actuator.ctrlrange = True, wanted.range
