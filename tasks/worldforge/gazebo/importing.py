"""Imports a world in Gazebo's format: makes model, map, floor plan and checks, and lists what was left out."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import hashlib
import os
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from ....schemas.worlds.gazebo_notes import GazeboNotes
from ....schemas.worlds.world import GazeboSource, Point, World
from ...sdf.lookup import Lookup
from ...sdf.meshes import Meshes
from ...sdf.reader import missing_parts, read_world
from ...sdf.sdf_types import Joint, Link, Pose, SdfError, SdfWorld, euler_matrix
from ..bundle.bundle import write_files
from ..bundle.survey import (
    floor_under,
    free_start,
    ground_at,
    in_the_way,
    known_map,
    usual_floor,
    world_bounds,
)
from ..seeds import GENERATOR_VERSION
from .bodies import Body, make_solids, moved, tie_bodies
from .holding import Rest, come_to_rest, pieces_around_joints
from .mjcf_text import Names, Scene, scene_text
from .solids import Solid, SolidMaker
from .visuals import Heightmaps, SeenGeom, Visuals
from .world_record import Drawn, NamedArea, bundle_texts, is_upright, world_of

Loose = Literal["hold", "free"]


class Start(NamedTuple):
    """Start position of robots in a Gazebo world file's frame."""

    x: float
    y: float
    yaw: float = 0.0
    z: float | None = None
    """Approximate height of the floor at the start, in metres; `None`: near 0, or the lowest floor."""


@dataclass(frozen=True, slots=True)
class Wishes:
    """Options of the import of a Gazebo world."""

    model_paths: Sequence[Path] = ()
    start: Start | None = None
    start_from: str | None = None
    """Launch file from which the robot's start position is read; `None`: there is none."""
    loose: Loose = "free"
    allow_missing: bool = False
    notes: GazeboNotes = field(default_factory=GazeboNotes)
    """Rooms and goals from the notes file, in the frame of the world file."""


def import_gazebo_world(path: Path, wishes: Wishes, folder: Path) -> World:
    """Imports a Gazebo world (SDF), and writes its files for MuJoCo.

    Args:
        path: The world file.
        wishes: Options.
        folder: A new folder for the bundle.

    Raises:
        SdfError: The file, or one that it includes, cannot be read; a model is missing; there is no floor under the
            start, or the start is not free.
    """
    lookup = Lookup(path, wishes.model_paths, os.environ)
    sdf = read_world(path, wishes.model_paths, os.environ)
    if not wishes.allow_missing and (missing := list(missing_parts(sdf))):
        raise SdfError(
            f"{path}: {len(missing)} {'model or file is' if len(missing) == 1 else 'models or files are'} missing: "
            f"{'; '.join(missing[:5])}{'; ...' if len(missing) > 5 else ''}. Name the folders of models with "
            "--model-path (or GAZEBO_MODEL_PATH), or import without them by --allow-missing"
        )
    return _Import(path, sdf, lookup, wishes).write(folder)


class _Import:
    def __init__(self, path: Path, sdf: SdfWorld, lookup: Lookup, wishes: Wishes) -> None:
        self._path, self._sdf, self._wishes = path, sdf, wishes
        self._meshes, self._heightmaps = Meshes(lookup), Heightmaps()
        self._names, self._pieces = Names(), dict[str, str]()
        self._bodies, self._fixed = tie_bodies(sdf)
        paths = {(link.model, link.path.rpartition("::")[0]) for link in sdf.links}
        self._inner = Counter(outer for outer, _ in paths)
        """Number of Gazebo models with links inside each outermost model."""
        self._maker = SolidMaker(sdf, self._meshes, {link.path for body in self._bodies for link in body.links})
        self._fixed_solids = make_solids(self._bodies, self._fixed, self._maker)
        self._visuals = Visuals(self._meshes, sdf.left_out)
        self._around_joints: set[str] = set()
        """Fixed pieces that a jointed body overlaps from the beginning, such as a door's frame.

        The two do not collide.
        """

    def write(self, folder: Path) -> World:
        rest = self._hold_first()
        self._around_joints = pieces_around_joints(self._compiled(rest.held, {}))
        settled = come_to_rest(lambda held, poses: self._compiled({**rest.held, **dict.fromkeys(held, "")}, poses))
        rest.held.update(settled.held)
        rest.poses.update(settled.poses)
        self._settle(rest)
        origin, is_chosen = self._origin(rest)
        shift = _shift(origin)
        self._move(shift)
        scene = self._scene(rest.held, {})
        model, data = _kinematics(scene_text(scene, self._bounds(None), None, self._heightmaps))
        ground = ground_at(model, data, 0.0, (0.0, 0.0))
        grid = known_map(ground, (0.0, 0.0))
        bounds = self._bounds((model, data))
        scene.seen, scene.seen_of = self._seen(rest.held)
        text = scene_text(scene, bounds, self._visuals, self._heightmaps)
        _compile(text, self._visuals.files)  # a mesh or picture that MuJoCo refuses would end every job
        source = GazeboSource(
            file=self._path.name,
            sha256=self._digest(),
            sdf_version=self._sdf.version,
            origin_m=(round(origin[0], 4) + 0.0, round(origin[1], 4) + 0.0, round(origin[2], 4) + 0.0),
            start_yaw=origin[3],
            is_start_chosen=is_chosen,
            start_from=self._wishes.start_from,
            models=len(self._sdf.model_types),
            goals={name: _moved_point(point, shift) for name, point in self._wishes.notes.goals.items()},
            held=rest.held,
            left_out=self._sdf.left_out.as_list(),
        )
        drawn = Drawn(
            model=model,
            data=data,
            ground=ground,
            grid=grid,
            loose=[name for name, body in scene.bodies if body.joint is None],
            kinds=self._kinds(),
            fixed=sorted({piece for piece, _ in scene.fixed}),
            rooms=self._rooms(shift),
        )
        world = world_of(drawn, source, GENERATOR_VERSION)
        write_files({**bundle_texts(world, text, grid), **self._visuals.files}, folder)
        return world

    def _rooms(self, shift: Pose) -> list[NamedArea]:
        """Returns the rooms of an imported world's notes file, in the world's frame.

        Raises SdfError if a room's edges would not run along the world's axes.
        """
        found: list[NamedArea] = []
        for name, room in self._wishes.notes.rooms.items():
            corners = [_moved_point(corner, shift) for corner in room.polygon]
            if not is_upright(corners):
                raise SdfError(
                    f"room {name!r} of the notes: its edges run along x and y of the file, and not along those of a "
                    "robot that starts with that yaw; a start yaw of quarter turns would be right"
                )
            found.append(NamedArea(name, room.type, corners))
        return found

    def _digest(self) -> str:
        digest = hashlib.sha256(self._path.read_bytes())
        for path in sorted(self._sdf.files):
            digest.update(f"{path.name}\0".encode())
            digest.update(path.read_bytes() if path.is_file() else b"")
        return digest.hexdigest()

    def _name(self, body: Body) -> str:
        """Returns the name of a body: its model's, plus its link's where the model has several bodies."""
        alone = sum(other.model == body.model for other in self._bodies) == 1
        alone &= not any(link.model == body.model for link in self._fixed)
        return self._names_of(body.model if alone else body.name)

    def _piece(self, link: Link) -> str:
        """Returns the name of a static link's furnishing: its outermost model's, unless that has several models."""
        own = link.path.rpartition("::")[0]
        return self._names_of(own if self._inner[link.model] > 1 else link.model)

    def _names_of(self, name: str) -> str:
        if name not in self._pieces:
            self._pieces[name] = self._names.new(name)
        return self._pieces[name]

    def _kinds(self) -> dict[str, str]:
        """Returns the kind of furniture of each piece and body of an imported world, by name."""
        types = self._sdf.model_types
        found = {self._piece(link): types[link.path.rpartition("::")[0]] for link in self._fixed}
        for body in self._bodies:
            found[self._name(body)] = types[body.links[0].path.rpartition("::")[0]]
        return found

    def _hold_first(self) -> Rest:
        """Returns the bodies to be held from the first on: those without collision shapes, which would fall for ever.

        If requested, all loose bodies are among them.
        """
        rest = Rest()
        for body in self._bodies:
            if not any(each.solids for each in self._bodies if each is body or each.parent is body):
                rest.held[self._name(body)] = "it has no collision shape"
            elif body.joint is None and self._wishes.loose == "hold":
                rest.held[self._name(body)] = "all loose bodies are held, as --loose hold says"
        return rest

    def _scene(self, held: Collection[str], poses: Mapping[str, Pose]) -> Scene:
        """Returns the world to be written as MJCF, with some bodies held fixed and others at new poses."""
        fixed: list[tuple[str, Solid]] = [(self._piece(link), solid) for link, solid in self._fixed_solids]
        bodies: list[tuple[str, Body]] = []
        shown: dict[int, Body] = {}
        for body, turn in _turns(self._bodies, {name: poses[name] for name in poses if name not in held}, self._name):
            name = self._name(body)
            if name in held:
                fixed += [(name, solid) for solid in body.solids]
                continue
            # A body that hangs on a held one by a joint stays a body: it hangs on the world then.
            shown[id(body)] = _copied(body, turn, shown.get(id(body.parent)))
            bodies.append((name, shown[id(body)]))
        tied = self._around_joints | {
            self._piece(link)
            for _, body in bodies
            if body.joint is not None
            for link in self._fixed
            if link.path in (body.joint.parent, body.joint.child)
        }
        return Scene(fixed, bodies, lights=self._sdf.lights, tied_pieces=frozenset(tied))

    def _compiled(self, held: Collection[str], poses: Mapping[str, Pose]) -> mujoco.MjModel:
        return _compile(scene_text(self._scene(held, poses), self._bounds(None), None, self._heightmaps))

    def _settle(self, rest: Rest) -> None:
        """Moves bodies to the poses in which they came to rest."""
        for body, turn in list(_turns(self._bodies, rest.poses, self._name)):
            if turn is not None:
                _move_body(body, turn)

    def _move(self, shift: Pose) -> None:
        moved(self._sdf, shift)
        for body in self._bodies:
            body.pose = shift @ body.pose
            body.solids = [_moved_solid(solid, shift) for solid in body.solids]
            body.joint = _moved_joint(body.joint, shift)
        self._fixed_solids = [(link, _moved_solid(solid, shift)) for link, solid in self._fixed_solids]

    def _origin(self, rest: Rest) -> tuple[tuple[float, float, float, float], bool]:
        """Returns the robot's start: x, y, height of the floor (metres), yaw (rad), and whether it was chosen here.

        Raises SdfError if the world has no floor or no free place, or the start that was named is not free.
        """
        model, data = _kinematics(scene_text(self._scene(rest.held, {}), self._bounds(None), None, self._heightmaps))
        wanted = self._wishes.start
        if wanted is None:
            floor_m = usual_floor(model, data)
            if floor_m is None:
                raise SdfError(f"{self._path}: it has no floor: nothing that collides is below any place in it")
            low, high = world_bounds(model, data)
            near = np.clip(0.0, low, high)  # a world may be far from the origin of its file
            start = free_start(ground_at(model, data, floor_m, (float(near[0]), float(near[1]))))
            if start is None:
                raise SdfError(
                    f"{self._path}: nowhere on its floor, which is at {floor_m:.2f} m, is a place of 1 m that is free; "
                    "name one with --start x,y,yaw"
                )
            height = floor_under(model, data, start, floor_m)
            return (*start, floor_m if height is None or abs(height - floor_m) > 0.05 else height, 0.0), True
        said = f"of {self._wishes.start_from} " if self._wishes.start_from else ""
        floor_m = floor_under(model, data, wanted[:2], wanted.z)
        if floor_m is None:
            low, high = world_bounds(model, data)
            raise SdfError(
                f"{self._path}: there is no floor under the start {said}({wanted.x:g}, {wanted.y:g}); the world "
                f"reaches from ({low[0]:.1f}, {low[1]:.1f}) to ({high[0]:.1f}, {high[1]:.1f}) m"
            )
        geoms = in_the_way(ground_at(model, data, floor_m, wanted[:2]), wanted[:2])
        if geoms is not None:
            there = ", ".join(dict.fromkeys(model.geom(geom).name.partition(".")[0] for geom in geoms[:3]))
            raise SdfError(
                f"{self._path}: the start {said}({wanted.x:g}, {wanted.y:g}) is not free within 0.5 m, on a floor at "
                f"{floor_m:.2f} m: {there or 'the floor ends'}; "
                "name another with --start x,y,yaw"
            )
        return (wanted.x, wanted.y, floor_m, wanted.yaw), False

    def _bounds(self, compiled: tuple[mujoco.MjModel, mujoco.MjData] | None) -> tuple[np.ndarray, np.ndarray]:
        if compiled is None:
            return np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, 2.0])
        return world_bounds(*compiled)

    def _seen(self, held: Collection[str]) -> tuple[list[tuple[str, SeenGeom]], dict[str, list[SeenGeom]]]:
        fixed = [(self._piece(link), seen) for link in self._fixed for seen in self._visuals.seen(link)]
        loose: dict[str, list[SeenGeom]] = {}
        for body in self._bodies:
            name = self._name(body)
            drawn = [seen for link in body.links for seen in self._visuals.seen(link)]
            if name in held:
                fixed += [(name, seen) for seen in drawn]
            else:
                loose[name] = drawn
        return fixed, loose


def _compile(text: str, files: Mapping[str, bytes] | None = None) -> mujoco.MjModel:
    try:
        return mujoco.MjModel.from_xml_string(text, assets=dict(files or {}))
    except ValueError as error:
        raise SdfError(f"MuJoCo does not accept the world that was made of it: {error}") from error


def _kinematics(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = _compile(text)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return model, data


def _shift(origin: tuple[float, float, float, float]) -> Pose:
    x, y, z, yaw = origin
    return Pose(np.array([x, y, z]), euler_matrix(0.0, 0.0, yaw)).inverse()


def _moved_point(point: Point, shift: Pose) -> Point:
    x, y, _ = shift.position + shift.rotation @ np.array([*point, 0.0])
    return round(float(x), 4), round(float(y), 4)


def _moved_solid(solid: Solid, shift: Pose) -> Solid:
    return replace(solid, pose=shift @ solid.pose)


def _move_body(body: Body, turn: Pose) -> None:
    """Moves a body with all shapes and joints that belong to it."""
    single = SdfWorld("", "", links=list(body.links))
    moved(single, turn)
    body.pose = turn @ body.pose
    body.solids = [_moved_solid(solid, turn) for solid in body.solids]
    body.joint = _moved_joint(body.joint, turn)


def _moved_joint(joint: Joint | None, turn: Pose) -> Joint | None:
    return joint and replace(joint, pose=turn @ joint.pose, axis=turn.rotation @ joint.axis)


def _turns(
    bodies: Sequence[Body], poses: Mapping[str, Pose], name_of: Callable[[Body], str]
) -> Iterator[tuple[Body, Pose | None]]:
    """Yields the displacement of each body with a new pose, and of bodies attached to it; `None` for others."""
    turns: dict[int, Pose | None] = {}
    for body in bodies:
        pose = poses.get(name_of(body))
        turns[id(body)] = turns.get(id(body.parent)) if pose is None else pose @ body.pose.inverse()
        yield body, turns[id(body)]


def _copied(body: Body, turn: Pose | None, parent: Body | None) -> Body:
    """Returns a copy of a body at another pose and with another parent.

    `turn` is the displacement from the old pose to the new one; `None` leaves the body where it is.
    """
    links = [
        Link(link.path, link.model, link.pose, link.is_static, link.inertia, [], link.visuals) for link in body.links
    ]
    copy = Body(body.name, links, body.pose, body.joint, body.is_reversed, parent, body.is_held, body.solids)
    if turn is not None:
        _move_body(copy, turn)
    return copy
