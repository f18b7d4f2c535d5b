"""Assembly of robots from `robot.yaml` and its model."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import logging
import math
from collections.abc import Mapping
from itertools import product
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from .....schemas.runs.ros_options import NOT_OF_ROBOTS
from ..robot import Lidar, Limits, Robot, sensor_type
from ..sensors.kind import Sensor, SensorKind
from .drive import make_drive, planar_joints
from .mapping import alternatives, invalid
from .model import FOLLOW_CAMERA, FOOTPRINT, FREE_JOINT, ModelBuilder, RobotFiles
from .shape import RobotLidar, RobotModel

_GEOM = mujoco.mjtGeom
_DIRECTIONS = 720
"""Number of horizontal directions in which the extent of round parts is measured; the error is at most 1e-5 of the
extent.
"""
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))

_Points = NDArray[np.float64]


def solid_reach_m(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Returns the largest horizontal distance from the origin of anything that collides, in metres."""
    solid = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0))
    return max((geom_reach_m(model, data, geom) for geom in solid.tolist()), default=0.0)


def geom_reach_m(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """Returns the largest horizontal distance of a geom's surface from the origin, in metres.

    Boxes, meshes (by their vertices), spheres and capsules are exact, and so are cylinders and ellipsoids that stand
    upright. Others are measured by their bounding boxes.
    """
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    middle, axes = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
    if kind == _GEOM.mjGEOM_SPHERE.value:
        return math.hypot(middle[0], middle[1]) + float(size[0])
    if kind == _GEOM.mjGEOM_CAPSULE.value:
        ends = np.array([[0.0, 0.0, -size[1]], [0.0, 0.0, size[1]]])
        return _farthest_m(middle + ends @ axes.T) + float(size[0])
    if kind == _GEOM.mjGEOM_CYLINDER.value:
        along = _directions(middle) @ axes[:2, 2]
        width = size[0] * np.sqrt(np.maximum(0.0, 1.0 - along**2)) + size[1] * np.abs(along)
        return _widest_m(middle, width)
    if kind == _GEOM.mjGEOM_ELLIPSOID.value:
        return _widest_m(middle, np.linalg.norm(_directions(middle) @ axes[:2] * size, axis=1))
    return _farthest_m(middle + _points(model, geom) @ axes.T)


def _points(model: mujoco.MjModel, geom: int) -> _Points:
    """Returns the outer points of a geom in its own frame: a mesh's vertices, else the corners of its bounding box."""
    mesh = int(model.geom_dataid[geom])
    if int(model.geom_type[geom]) == _GEOM.mjGEOM_MESH.value and mesh >= 0:
        first = int(model.mesh_vertadr[mesh])
        return np.asarray(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], dtype=float)
    return model.geom_aabb[geom, :3] + _CORNERS * model.geom_aabb[geom, 3:]


def _directions(middle: _Points) -> _Points:
    """Returns horizontal unit vectors all around, beginning with the direction to a geom's centre."""
    angles = math.atan2(middle[1], middle[0]) + np.linspace(0.0, 2 * math.pi, _DIRECTIONS, endpoint=False)
    return np.column_stack((np.cos(angles), np.sin(angles)))


def _widest_m(middle: _Points, width_m: _Points) -> float:
    """Returns the extent of a convex shape in metres: the largest value of its support function."""
    return float((_directions(middle) @ middle[:2] + width_m).max())


def _farthest_m(points: _Points) -> float:
    return float(np.hypot(points[:, 0], points[:, 1]).max())


_logger = logging.getLogger(__name__)

_OVERHANG_M = 0.01
"""Length in metres by which parts may stick out of the footprint before a warning."""

_TOO_LARGE = 20
"""Maximum extent of a robot's parts, in radii of its footprint.

This detects parts in millimetres from a fiftieth of the radius on, those in inches from half of it on.
"""

_TOO_SMALL = 100
"""Divisor of the footprint's radius that gives the minimum extent of a robot; a model in millimetres that is scaled
twice is 1000 times too small.
"""

_SINGLE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
"""Joint types with one coordinate, as integers, because NumPy's numbers equal MuJoCo's enum members only on one side of
`==`.
"""


def make_robot(mapping: RobotModel, files: RobotFiles, default_name: str) -> Robot:
    """Makes a robot from its `robot.yaml` and model files.

    Args:
        mapping: Content of `robot.yaml`.
        files: Paths of `robot.yaml` and of the model.
        default_name: Name of the robot if `robot.yaml` has none.

    Raises:
        LaunchError: The model cannot be read, or a name in the mapping is not in it.
    """
    builder = ModelBuilder(mapping, files)
    model = builder.compile()
    planar = planar_joints(mapping, model, files.mapping.name)
    home = {name: value for name, value in _home(mapping, builder, model).items() if name not in (planar or ())}
    _check_shapes(model, files.mapping.name)
    data = _standing(model, mapping, home)
    if planar:
        # Now that it is known which body moves over the floor, its place there can be marked.
        builder.carrier = model.body(int(model.jnt_bodyid[model.joint(planar[2]).id])).name
        builder.footprint_z_m = -float(data.body(builder.carrier).xpos[2])
        model = builder.compile()
        data = _standing(model, mapping, home)
    limits = _limits(mapping)
    _check_sizes(mapping, model, data, builder, files)
    _warn_of_overhang(mapping, model, data, files.mapping.name)
    return Robot(
        name=mapping.name or default_name,
        build=builder.build,
        base=mapping.base,
        footprint=FOOTPRINT,
        free_joint=None if planar else FREE_JOINT,
        planar_joints=planar,
        limits=limits,
        drive=make_drive(mapping, limits, model, data, files.mapping.name),
        joints=_joints(mapping, model, files.mapping.name),
        spawn_height_m=mapping.spawn.height_m,
        home=home,
        lidar=_lidar(mapping, model, data, files.mapping.name),
        proximity_height_m=mapping.sensors.bumper_height_m,
        sensors=[_sensor(each, model, files.mapping.name) for each in mapping.sensors.of_kinds()],
        video_camera=_video_camera(mapping, model, files.mapping.name),
        ros=_ros(mapping, files.mapping.name),
    )


def _limits(mapping: RobotModel) -> Limits:
    drive, radius_m = mapping.drive, mapping.footprint.radius_m
    if drive.kind == "actuators":
        return Limits(radius_m, drive.max_linear_mps, drive.max_angular_radps)
    ramps = drive.max_linear_mps2, drive.max_angular_radps2
    return Limits(radius_m, drive.max_linear_mps, drive.max_angular_radps, *ramps)


def _home(mapping: RobotModel, builder: ModelBuilder, model: mujoco.MjModel) -> dict[str, float]:
    there = _single_joints(model)
    home = {name: value for name, value in builder.keyframe().items() if name in there}
    for name, value in mapping.spawn.joints.items():
        if name not in there:
            hint = alternatives(name, there, "joints")
            raise invalid(builder.where, f"spawn.joints: there is no hinge or slide {name!r}; {hint}")
        home[name] = value
    return home


def _standing(model: mujoco.MjModel, mapping: RobotModel, home: Mapping[str, float]) -> mujoco.MjData:
    """Returns a state in which the robot stands at the origin."""
    data = mujoco.MjData(model)
    for joint in range(model.njnt):
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            first = int(model.jnt_qposadr[joint])
            data.qpos[first : first + 7] = (0, 0, mapping.spawn.height_m, 1, 0, 0, 0)
    for name, value in home.items():
        data.qpos[int(model.joint(name).qposadr[0])] = value
    mujoco.mj_forward(model, data)
    return data


def _single_joints(model: mujoco.MjModel) -> list[str]:
    return [model.joint(index).name for index in range(model.njnt) if int(model.jnt_type[index]) in _SINGLE]


def _joints(mapping: RobotModel, model: mujoco.MjModel, where: str) -> tuple[str, ...]:
    there = [name for name in _single_joints(model) if name]
    for index, name in enumerate(mapping.joints or ()):
        if name not in there:
            hint = alternatives(name, there, "joints")
            raise invalid(where, f"joints[{index}]: there is no hinge or slide {name!r}; {hint}")
    return tuple(there if mapping.joints is None else mapping.joints)


def _lidar(mapping: RobotModel, model: mujoco.MjModel, data: mujoco.MjData, where: str) -> Lidar | None:
    lidar = mapping.sensors.lidar
    if lidar is None:
        return None
    if lidar.range_min_m >= lidar.range_max_m:
        raise invalid(
            where, f"sensors.lidar.range_min_m: {lidar.range_min_m:g} is not below range_max_m, {lidar.range_max_m:g}"
        )
    return Lidar(
        height_m=_lidar_height_m(lidar, model, data, where),
        rate_hz=lidar.rate_hz,
        rays=lidar.rays,
        field_of_view_rad=math.radians(lidar.field_of_view_deg),
        range_min_m=lidar.range_min_m,
        range_max_m=lidar.range_max_m,
        noise_std_m=lidar.noise_std_m,
    )


def _lidar_height_m(lidar: RobotLidar, model: mujoco.MjModel, data: mujoco.MjData, where: str) -> float:
    if (lidar.at is None) == (lidar.height_m is None):
        raise invalid(where, "sensors.lidar: give either at (a site or body) or height_m (metres over the floor)")
    if lidar.at is None:
        assert lidar.height_m is not None
        return lidar.height_m
    places = {model.body(index).name: data.xpos[index] for index in range(1, model.nbody)}
    places |= {model.site(index).name: data.site_xpos[index] for index in range(model.nsite)}
    if lidar.at not in places:
        hint = alternatives(lidar.at, places, "bodies and sites")
        raise invalid(where, f"sensors.lidar.at: there is no site or body {lidar.at!r}; {hint}")
    x, y, z = (float(value) for value in places[lidar.at])
    if math.hypot(x, y) > _OVERHANG_M:
        _logger.warning("%s: sensors.lidar: %s is off the middle; scans are made over the middle", where, lidar.at)
    if z <= 0:
        raise invalid(where, f"sensors.lidar.at: {lidar.at!r} is {z:.3f} m over the floor; it has to be above it")
    return z


def _sensor(sensor: SensorKind, model: mujoco.MjModel, where: str) -> Sensor:
    if sensor.at is not None:
        return Sensor(type(sensor), sensor.own_names)
    names = [getattr(sensor, part) for part in sensor.parts]
    if None in names:
        own = f"{'both ' if len(names) == 2 else ''}{' and '.join(sensor.parts)} (names of sensors)"
        raise invalid(where, f"sensors.{sensor.name}: give at (a body or site), or {own}")
    for (part, kind), name in zip(sensor.parts.items(), names, strict=True):
        number = int(sensor_type(kind))
        there = [model.sensor(index).name for index in range(model.nsensor) if model.sensor_type[index] == number]
        if name not in there:
            hint = alternatives(name, there, f"{part} sensors")
            raise invalid(where, f"sensors.{sensor.name}.{part}: there is no {part} {name!r}; {hint}")
        if int(model.sensor(name).objtype[0]) != int(mujoco.mjtObj.mjOBJ_SITE):
            problem = f"{part} {name!r} is not on a site, which says where it is; give it a site in the model"
            raise invalid(where, f"sensors.{sensor.name}.{part}: {problem}")
    return Sensor(type(sensor), names)


def _ros(mapping: RobotModel, where: str) -> dict[str, Any]:
    """Returns the options of the ROS bridge; options that are needed before this file is read are an error."""
    given = mapping.ros.model_dump(exclude_unset=True) if mapping.ros is not None else {}
    for name in NOT_OF_ROBOTS:
        if name in given:
            raise invalid(where, f"ros.{name}: it is needed before this file is read; set it in ROBOMAKER_ROS")
    return given


def _video_camera(mapping: RobotModel, model: mujoco.MjModel, where: str) -> str:
    there = [model.camera(index).name for index in range(model.ncam)]
    name = mapping.video_camera or FOLLOW_CAMERA
    if name not in there:
        raise invalid(where, f"video_camera: there is no camera {name!r}; {alternatives(name, there, 'cameras')}")
    return name


def _check_shapes(model: mujoco.MjModel, where: str) -> None:
    """Raises an error for a robot without collision shapes, which would go through walls unnoticed."""
    collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    if not (collides & (model.geom_bodyid > 0)).any():
        raise invalid(
            where,
            "model: the robot has no shape that collides, so it would go through walls; give a link of a URDF "
            "or SDF <collision>, or a geom of MJCF contype and conaffinity above 0",
        )


def _check_sizes(
    mapping: RobotModel, model: mujoco.MjModel, data: mujoco.MjData, builder: ModelBuilder, files: RobotFiles
) -> None:
    """Raises an error for parts in a unit other than metres, which make the robot far too large or small."""
    radius_m, where = mapping.footprint.radius_m, files.mapping.name
    for geom in range(model.ngeom):
        reach_m = geom_reach_m(model, data, geom)
        if reach_m <= _TOO_LARGE * radius_m:
            continue
        said = f"reaches {reach_m:.3g} m from the base's origin, {reach_m / radius_m:.0f} times footprint.radius_m"
        if int(model.geom_type[geom]) != _GEOM.mjGEOM_MESH.value:
            link = model.body(int(model.geom_bodyid[geom])).name
            raise invalid(where, f"footprint.radius_m: a shape of {link!r} {said}, {radius_m:g} m; correct one of them")
        name = model.mesh(int(model.geom_dataid[geom])).name
        use = next((each for each in builder.reading.meshes if each.name == name), None)
        scale = [0.001 * float(each) for each in use.scale.split()] if use is not None and use.scale else [0.001] * 3
        shown = " ".join(f"{each:g}" for each in scale)
        raise invalid(
            f"{files.model}:{use.line}" if use is not None else files.model,
            f"the mesh {use.written if use is not None else name!r} {said}, {radius_m:g} m; lengths are in metres. If "
            f'the mesh is in millimetres, scale="{shown}" is meant in its <mesh>; otherwise correct footprint.radius_m',
        )
    reach_m = solid_reach_m(model, data)
    if reach_m * _TOO_SMALL < radius_m:
        raise invalid(
            where,
            f"footprint.radius_m: what collides of the robot reaches {reach_m:.3g} m from the base's origin and the "
            f"radius is {radius_m:g} m; lengths are in metres, so correct the scale of its meshes or the radius",
        )


def _warn_of_overhang(mapping: RobotModel, model: mujoco.MjModel, data: mujoco.MjData, where: str) -> None:
    """Warns if parts reach beyond the disc of the footprint: planners would drive into obstacles."""
    reach_m = solid_reach_m(model, data)
    if reach_m > mapping.footprint.radius_m + _OVERHANG_M:
        _logger.warning(
            "%s: footprint.radius_m: parts reach up to %.2f m from the base's origin, the radius is %g m",
            where, reach_m, mapping.footprint.radius_m,
        )  # fmt: skip
