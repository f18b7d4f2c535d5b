"""Robots in SDF, Gazebo's format: converts links to MuJoCo bodies, with the SDF reader for worlds."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections import Counter
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ....sdf.lookup import Lookup
from ....sdf.meshes import MeshError, Meshes
from ....sdf.reader import missing_parts, read_world
from ....sdf.sdf_types import Collision, Geometry, Joint, Link, Pose, SdfError, SdfWorld, Visual, identity
from .mapping import invalid
from .robot_files import check_inside, folders_between
from .urdf import UrdfReading

MENDED = "inertias that were mended"
_MOST_NAMED = 8
_USUAL_MASS_KG = 1.0
"""Mass in kg of a link without a mass, as in Gazebo."""
_DRAWN_GROUP, _SOLID_GROUP = 2, 3
"""Geom groups of visual geoms, and of geoms that only collide."""
_KINDS = {
    "hinge": mujoco.mjtJoint.mjJNT_HINGE,
    "slide": mujoco.mjtJoint.mjJNT_SLIDE,
    "ball": mujoco.mjtJoint.mjJNT_BALL,
}
_SHAPES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
}
_NO_HOME = {"HOME": "/nonexistent"}
"""Environment variables without search paths, so that a robot's files are found in its own folder on every machine."""


def read_sdf(path: Path, root: Path, reading: UrdfReading) -> mujoco.MjSpec:
    """Makes and returns the MuJoCo model, not compiled yet, of a robot in SDF.

    Args:
        path: Path of the file with a `<model>`.
        root: Folder that has to contain all files.
        reading: State of reading the file: options and problems.

    Raises:
        LaunchError: The file cannot be read, a file is missing or outside of the folder, an inertia is impossible, or
            the file is not one model whose joints are one tree.
    """
    folders = folders_between(path.parent, root)
    try:
        world = read_world(path, folders, _NO_HOME)
    except SdfError as error:
        raise invalid(path, str(error).removeprefix(f"{path}").lstrip(": ")) from error
    for file in sorted(world.files):
        check_inside(path, file, root, file.name)
    if missing := list(missing_parts(world)):
        raise invalid(path, f"there is no {missing[0]}; files of a robot are in its own folder, {root}")
    _check_is_one(path, world)
    for left in world.left_out.as_list():
        if left.what != MENDED:
            reading.warn(f"{path.name}: {left.count} {left.what}: {', '.join(left.names)}")
    if (mended := world.left_out.names(MENDED)) and not reading.from_geometry:
        raise invalid(
            path,
            f"no body can have the inertia of {', '.join(mended[:5])}; correct it, or let robot.yaml say "
            "impossible_inertia: from_geometry",
        )
    return _Writer(path, world, Meshes(Lookup(path, folders, _NO_HOME)), reading).spec


def _check_is_one(path: Path, world: SdfWorld) -> None:
    """Raises an error for a file with a ground, several models, or two links of the same name."""
    for part in (each for link in world.links for each in link.collisions):
        if part.geometry.kind == "plane":
            raise invalid(path, f"{part.name} is a plane; leave the ground out of a robot, worlds have theirs")
    models = [name for name in world.model_types if "::" not in name]
    if len(models) > 1:
        raise invalid(path, f"it has {len(models)} models, {_listed(models)}; a robot is one model")
    for name, times in Counter(link.path for link in world.links).items():
        if times > 1:
            raise invalid(path, f"it has two links {name}; each link has a name of its own")


class _Writer:
    """Builds the MuJoCo model of a robot from an SDF; what cannot be converted raises `LaunchError`."""

    def __init__(self, path: Path, world: SdfWorld, meshes: Meshes, reading: UrdfReading) -> None:
        self._path, self._meshes, self._reading = path, meshes, reading
        self.spec = mujoco.MjSpec()
        self.spec.compiler.degree = False
        self._names: dict[Geometry, str] = {}
        self._links = {link.path: link for link in world.links}
        self._joints = {joint.child: joint for joint in self._tree(world.joints)}
        self._check_root()
        self._geom_names: set[str] = set()
        self._joint_names: set[str] = set()
        made: dict[str, Any] = {}
        for link in self._in_order():
            joint = self._joints.get(link.path)
            above = made.get(joint.parent, self.spec.worldbody) if joint else self.spec.worldbody
            around = self._links[joint.parent].pose if joint and joint.parent in self._links else None
            made[link.path] = self._body(link, joint, above, around)

    def _tree(self, joints: list[Joint]) -> Iterator[Joint]:
        """Yields the joints that move a link of their own, in the order of the file.

        Raises `LaunchError` if a link is missing, or the joints are not a tree.
        """
        above: dict[str, str] = {}
        for joint in joints:
            for name in (joint.parent, joint.child):
                if name not in self._links and name != "world":
                    raise invalid(self._path, f"joint {joint.path}: there is no link {name!r}")
            up = joint.parent
            while up in above and up != joint.child:
                up = above[up]
            if joint.child in above or up == joint.child:
                raise invalid(
                    self._path,
                    f"joint {joint.path}: link {joint.child} hangs on another joint already, or on itself; joints of a "
                    "robot have to be a tree",
                )
            above[joint.child] = joint.parent
            yield joint

    def _check_root(self) -> None:
        """Raises an error for links that are not connected to the robot: only one tree is put into a world."""
        hanging = {name for name, joint in self._joints.items() if joint.parent != "world"}
        roots = [_without_model_name(name) for name in self._links if name not in hanging]
        if len(roots) > 1:
            raise invalid(
                self._path,
                f"it has {len(roots)} outermost links, {_listed(roots)}; a robot has one outermost link, on which the "
                "others hang by joints",
            )

    def _in_order(self) -> Iterator[Link]:
        """Yields the links of an SDF robot, each after its parent link."""
        done: set[str] = set()
        left = list(self._links.values())
        while left:
            ready = [
                each
                for each in left
                if (joint := self._joints.get(each.path)) is None or joint.parent in done or joint.parent == "world"
            ]
            yield from ready
            done |= {each.path for each in ready}
            left = [each for each in left if each.path not in done]

    def _body(self, link: Link, joint: Joint | None, above: Any, around: Pose | None) -> Any:
        # The outermost link stands at the origin, as that of a URDF: robot.yaml says how high it is.
        pose = identity() if around is None else around.inverse() @ link.pose
        body = above.add_body(name=_without_model_name(link.path), pos=pose.position, quat=_quaternion(pose.rotation))
        inside = link.pose.inverse()
        if joint is not None and joint.kind != "fixed":
            self._joint(body, joint, inside)
        geoms = [geom for each in link.collisions if (geom := self._geom(body, each, inside, link)) is not None]
        for visual in link.visuals:
            self._geom(body, visual, inside, link)
        inertia = link.inertia
        if inertia is not None and inertia.moments is not None:
            at = inside @ inertia.pose
            turned = at.rotation @ inertia.moments @ at.rotation.T
            body.explicitinertial, body.mass, body.ipos = True, inertia.mass_kg, at.position
            body.fullinertia = [turned[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        else:
            for geom in geoms:
                geom.mass = (inertia.mass_kg if inertia is not None else _USUAL_MASS_KG) / len(geoms)
        return body

    def _joint(self, body: Any, joint: Joint, inside: Pose) -> None:
        name = _numbered(_without_model_name(joint.path), self._joint_names)
        made = body.add_joint(name=name, type=_KINDS[joint.kind], pos=(inside @ joint.pose).position)
        made.damping = [max(joint.damping, 0.0), 0.0, 0.0]  # linear in the speed, as Gazebo has it
        made.frictionloss = max(joint.friction, 0.0)
        if joint.kind == "ball":
            return
        made.axis = inside.rotation @ joint.axis
        if joint.lower is not None or joint.upper is not None:
            far = 1e3 if joint.kind == "slide" else 100 * np.pi  # MuJoCo knows two limits or none
            made.limited = True
            made.range = [-far if joint.lower is None else joint.lower, far if joint.upper is None else joint.upper]

    def _geom(self, body: Any, part: Collision | Visual, inside: Pose, link: Link) -> Any | None:
        """Adds a collision geom, which has all of the mass, or a visual geom to a body, and returns it.

        Returns `None` for a visual that cannot be shown. Raises `LaunchError` for a collision shape that robots cannot
        have.

        Args:
            body: Body of the link in MuJoCo.
            part: Collision or visual of the link.
            inside: Pose of the link in the body.
            link: The link.
        """
        collides, geometry, pose = isinstance(part, Collision), part.geometry, inside @ part.pose
        if geometry.kind != "mesh" and geometry.kind not in _SHAPES:
            if collides:
                raise invalid(self._path, f"{part.name}: robots collide with {', '.join(_SHAPES)} and meshes")
            return None
        if geometry.kind == "mesh":
            mesh = self._mesh(geometry, part.name, collides)
            if mesh is None:
                return None
            geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh)
        else:
            geom = body.add_geom(type=_SHAPES[geometry.kind], size=_size(geometry))
        geom.pos, geom.quat = pose.position, _quaternion(pose.rotation)
        geom.name = _numbered(
            _without_model_name(part.name) if collides else f"{_without_model_name(part.name)}_drawn", self._geom_names
        )
        if isinstance(part, Collision):
            geom.friction = [part.friction, 0.005, 0.0001]
            geom.group = _SOLID_GROUP if link.visuals else _DRAWN_GROUP
        else:
            geom.contype = geom.conaffinity = 0
            geom.mass, geom.group, geom.rgba = 0.0, _DRAWN_GROUP, part.material.color
        return geom

    def _mesh(self, geometry: Geometry, where: str, collides: bool) -> str | None:
        """Adds a mesh to the model, once, and returns its name; MuJoCo collides with its hull.

        Returns `None`, with a warning, if it is visual and cannot be read. Raises `LaunchError` if a mesh that collides
        cannot be read.
        """
        if geometry in self._names:
            return self._names[geometry]
        try:
            triangles = self._meshes.triangles(geometry)
        except MeshError as error:
            if collides:
                raise invalid(self._path, f"{where}: {error.short}") from error
            self._reading.warn(f"{self._path.name}: {where} is not shown: {error.short}")
            return None
        points, faces = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
        assert geometry.file is not None
        name = f"{geometry.file.stem.replace('.', '_')}_{len(self._names)}"
        mesh = self.spec.add_mesh(name=name, uservert=points.ravel(), userface=faces.ravel().astype(np.int32))
        if not collides:
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # what is only drawn may have no volume
        self._names[geometry] = name
        return name


def _listed(names: list[str]) -> str:
    if len(names) > _MOST_NAMED:
        return f"{', '.join(names[:_MOST_NAMED])}, ..."
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _numbered(name: str, taken: set[str]) -> str:
    """Returns a name that is unique among shapes or joints, with a number if it is taken, and adds it to `taken`."""
    names = (name if number == 1 else f"{name}_{number}" for number in count(1))
    taken.add(found := next(each for each in names if each not in taken))
    return found


def _without_model_name(path: str) -> str:
    """Returns a name without the prefix of the model's own name."""
    return path.partition("::")[2] or path


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, rotation.ravel())
    return quat


def _size(geometry: Geometry) -> list[float]:
    size = list(geometry.size)
    match geometry.kind:
        case "box":
            return [extent / 2 for extent in size]
        case "cylinder" | "capsule":
            return [size[0], size[1] / 2, 0.0]
        case "sphere":
            return [size[0], 0.0, 0.0]
        case _:
            return size
