"""Variations of worlds that were imported from Gazebo: other light or friction, and loose bodies moved or removed."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import re
import xml.etree.ElementTree as ET
from difflib import get_close_matches
from math import radians
from pathlib import Path

import mujoco
import numpy as np

from ....schemas.wire.errors import ConfigurationError
from ....schemas.worlds.appearance import APPEARANCES, DAY, relit
from ....schemas.worlds.description import DESCRIPTION_FILE
from ....schemas.worlds.world import PREVIEW_FILE, WORLD_FILE, Change, GazeboSource, Variation, World
from ...sdf.sdf_types import Pose, euler_matrix
from ..bundle.bundle import MODEL_FILE, content_hash, read_world, write_files
from ..bundle.robot_map import MAP_FILES
from ..bundle.survey import ground_at, known_map
from ..generator import Move, Wanted
from .mjcf_text import DAY_SKY, numbers, quaternion
from .world_record import AREA, Drawn, NamedArea, bundle_texts, world_of

_MOST_NAMED = 12
_MOST_FRICTION = 10.0
"""Largest sliding friction that can be requested: nothing slides on a surface with more."""
_REWRITTEN_FILES = {WORLD_FILE, MODEL_FILE, DESCRIPTION_FILE, PREVIEW_FILE, "floorplan.svg", *MAP_FILES}
"""Files of a bundle that are written anew for a variation, and not copied from the original world."""


def vary_imported(bundle: Path, wanted: Wanted, arn: str | None, folder: Path) -> World:
    """Makes a variation of an imported world, measures it anew, and writes its bundle.

    Args:
        bundle: Bundle of the original world, which is not changed.
        wanted: Requested changes; doors cannot differ.
        arn: ARN of the original world.
        folder: A new folder for the bundle.

    Raises:
        ConfigurationError: The world has no such object, the object cannot be moved, or the variation equals the world.
    """
    world = read_world(bundle)
    if wanted.doors:
        raise ConfigurationError(
            f"door {next(iter(wanted.doors))}: doors of worlds that were imported from Gazebo stand as the file says; "
            "light, friction, and loose bodies to move or remove would be right"
        )
    model = _Model((bundle / MODEL_FILE).read_text(encoding="utf-8"), world)
    changes = [
        *(model.move(name, move) for name, move in wanted.moved.items()),
        *(model.remove(name) for name in wanted.removed),
        *(model.set_friction(name, friction) for name, friction in wanted.friction.items()),
    ]
    light = wanted.light or world.appearance
    if light != world.appearance:
        changes.append(Change(what="light", thing="world", before=world.appearance, after=light))
    if not changes:
        raise ConfigurationError(f"nothing would differ: the world's light is {world.appearance} already")
    text = model.text()
    if light != world.appearance:
        text = relit(text, APPEARANCES[light])
        text = re.sub(r'<texture name="sky" [^>]*/>', DAY_SKY, text) if light == DAY else text
    taken = {
        path.relative_to(bundle).as_posix(): path.read_bytes()
        for path in sorted(bundle.rglob("*"))
        if path.is_file() and path.relative_to(bundle).as_posix() not in _REWRITTEN_FILES
    }
    compiled = _compiled(text, taken)
    variation = Variation(of_content=content_hash(bundle), of_world=arn, changes=changes)
    varied, files = _measured(world, compiled, text, {"appearance": light, "variation": variation})
    write_files({**taken, **files}, folder)
    return varied


def _compiled(text: str, files: dict[str, bytes]) -> mujoco.MjModel:
    try:
        return mujoco.MjModel.from_xml_string(text, assets=files)
    except ValueError as error:
        raise ConfigurationError(f"MuJoCo does not accept the variation: {error}") from error


def _measured(
    world: World, model: mujoco.MjModel, text: str, update: dict[str, object]
) -> tuple[World, dict[str, bytes]]:
    """Draws and checks the world of a changed MuJoCo model; returns it with its description files."""
    source = world.source
    assert isinstance(source, GazeboSource)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    ground = ground_at(model, data)
    grid = known_map(ground, (0.0, 0.0))
    rooms = [NamedArea(room.name, room.type, [*room.polygon]) for room in world.floorplan.rooms]
    free = {int(model.jnt_bodyid[joint]) for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)}
    drawn = Drawn(
        model=model,
        data=data,
        ground=ground,
        grid=grid,
        loose=[model.body(body).name for body in sorted(free)],
        kinds={item.id: item.model_type for item in world.furniture},
        fixed=sorted({model.geom(int(geom)).name.partition(".")[0] for geom in np.flatnonzero(model.geom_bodyid == 0)}),
        rooms=[] if [(room.name, room.type) for room in rooms] == [(AREA, "Area")] else rooms,
    )
    varied = world_of(drawn, source, world.generator_version).model_copy(update=update)
    return varied, bundle_texts(varied, text, grid)


class _Model:
    """The MJCF of an imported world, whose pieces can be changed."""

    def __init__(self, text: str, world: World) -> None:
        self._root = ET.fromstring(text)  # noqa: S314 (written here, not by somebody else)
        found = self._root.find("worldbody")
        assert found is not None
        self._world = found
        self._middles = {item.id: (item.x, item.y) for item in world.furniture}
        self._bodies = {body.get("name", ""): body for body in found.findall("body")}

    def text(self) -> str:
        """Returns the current MJCF text of the world."""
        return ET.tostring(self._root, encoding="unicode") + "\n"

    def move(self, name: str, by: Move) -> Change:
        """Moves a loose body of the world in its model, and returns the change; objects on it stay where they are.

        Raises ConfigurationError if there is no loose body of that name.
        """
        loose = [each for each, body in self._bodies.items() if body.find("freejoint") is not None]
        if name not in loose:
            raise ConfigurationError(f"{name}: there is no such loose body; {_alternatives(name, loose)}")
        body = self._bodies[name]
        place = np.array([float(each) for each in body.get("pos", "0 0 0").split()])
        x, y = self._middles.get(name, (float(place[0]), float(place[1])))
        middle, turn = np.array([x, y, 0.0]), euler_matrix(0.0, 0.0, radians(by.turn_deg))
        moved = middle + turn @ (place - middle) + np.array([by.east_m, by.north_m, 0.0])
        quat = np.array([float(each) for each in body.get("quat", "1 0 0 0").split()])
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, quat)
        pose = Pose(moved, turn @ rotation.reshape(3, 3))
        body.set("pos", numbers(*pose.position))
        body.set("quat", " ".join(f"{value:.7g}" for value in quaternion(pose.rotation)))
        after = f"moved by {by.east_m:g} m east, {by.north_m:g} m north, turned by {by.turn_deg:g} degrees"
        return Change(what="moved", thing=name, before=f"at ({x:.2f}, {y:.2f})", after=after)

    def remove(self, name: str) -> Change:
        """Removes a movable body or a fixed piece from the world."""
        parts = [self._bodies[name]] if name in self._bodies else self._geoms(self._world, name)
        self._check(name, bool(parts))
        for part in parts:
            self._world.remove(part)
        self._bodies.pop(name, None)
        return Change(what="removed", thing=name, before="there", after="not there")

    def set_friction(self, name: str, friction: float) -> Change:
        """Sets the sliding friction of a piece (or of all pieces: `*`) against whatever touches it.

        Of two geoms MuJoCo takes the larger friction, unless one has a higher priority: the one that was set last has.

        Raises ConfigurationError for a friction that is out of its range, and for a name that no piece has.
        """
        if not 0 <= friction <= _MOST_FRICTION:
            raise ConfigurationError(
                f"friction of {name}: {friction:g}; a number from 0 to {_MOST_FRICTION:g} would be right"
            )
        geoms = [geom for geom in self._solid() if name == "*" or geom.get("name", "").partition(".")[0] == name]
        self._check(name, bool(geoms))
        before = sorted({float(geom.get("friction", "1").split()[0]) for geom in geoms})
        priority = 1 + max(int(geom.get("priority", "0")) for geom in self._world.iter("geom"))
        for geom in geoms:
            geom.set("priority", str(priority))
            _, *rest = geom.get("friction", "1 0.005 0.0001").split()
            geom.set("friction", " ".join([numbers(friction), *rest]))
        said = f"{before[0]:g}" if len(before) == 1 else f"{before[0]:g} to {before[-1]:g}"
        return Change(what="friction", thing=name, before=said, after=f"{friction:g}")

    def _solid(self) -> list[ET.Element]:
        return [
            geom for geom in self._world.iter("geom") if geom.get("contype") != "0" or geom.get("conaffinity") != "0"
        ]

    def _geoms(self, parent: ET.Element, piece: str) -> list[ET.Element]:
        return [geom for geom in parent.findall("geom") if geom.get("name", "").partition(".")[0] == piece]

    def _check(self, name: str, is_there: bool) -> None:
        if not is_there:
            pieces = {geom.get("name", "").partition(".")[0] for geom in self._world.iter("geom")}
            raise ConfigurationError(f"{name}: there is no such piece; {_alternatives(name, sorted(pieces))}")


def _alternatives(name: str, there: list[str]) -> str:
    near = get_close_matches(name, there, n=1)
    if near:
        return f"did you mean {near[0]}?"
    more = ", ..." if len(there) > _MOST_NAMED else ""
    return f"there are {', '.join(there[:_MOST_NAMED])}{more}" if there else "there is none"
