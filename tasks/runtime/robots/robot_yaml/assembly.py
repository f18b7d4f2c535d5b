"""Assembly of robots from `robot.yaml` and its model."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import logging
import math
from collections.abc import Mapping
from typing import Any

import mujoco

from .....schemas.runs.ros_options import NOT_OF_ROBOTS
from ..robot import Lidar, Limits, Robot, sensor_type
from ..sensors.kind import Sensor, SensorKind
from .drive import make_drive, planar_joints
from .mapping import alternatives, invalid
from .model import FOLLOW_CAMERA, FOOTPRINT, FREE_JOINT, ModelBuilder, RobotFiles
from .shape import RobotLidar, RobotModel
from .size_checks import check_shapes, check_sizes, overhang

_logger = logging.getLogger(__name__)

_OFF_MIDDLE_M = 0.01
"""Distance in metres from the base's origin from which a lidar counts as off the middle."""

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
    check_shapes(model, files.mapping.name)
    data = _standing(model, mapping, home)
    if planar:
        # Now that it is known which body moves over the floor, its place there can be marked.
        builder.carrier = model.body(int(model.jnt_bodyid[model.joint(planar[2]).id])).name
        builder.footprint_z_m = -float(data.body(builder.carrier).xpos[2])
        model = builder.compile()
        data = _standing(model, mapping, home)
    limits = _limits(mapping)
    check_sizes(mapping, model, data, builder, files)
    where = files.mapping.name
    warnings = overhang(mapping, model, data, where)
    drive = make_drive(mapping, limits, model, data, where, warnings.append)
    for text in warnings:
        _logger.warning("%s", text)
    return Robot(
        name=mapping.name or default_name,
        build=builder.build,
        base=mapping.base,
        footprint=FOOTPRINT,
        free_joint=None if planar else FREE_JOINT,
        planar_joints=planar,
        limits=limits,
        drive=drive,
        joints=_joints(mapping, model, where),
        spawn_height_m=mapping.spawn.height_m,
        home=home,
        lidar=_lidar(mapping, model, data, where),
        proximity_height_m=mapping.sensors.bumper_height_m,
        sensors=[_sensor(each, model, where) for each in mapping.sensors.of_kinds()],
        video_camera=_video_camera(mapping, model, where),
        ros=_ros(mapping, where),
        warnings=tuple(warnings),
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
    """Returns a state in which the robot stands at the origin, with its joints in their home positions."""
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
        hint = alternatives(lidar.at, places, "bodies and sites", "sensors.lidar.at")
        raise invalid(where, f"sensors.lidar.at: there is no site or body {lidar.at!r}; {hint}")
    x, y, z = (float(value) for value in places[lidar.at])
    if math.hypot(x, y) > _OFF_MIDDLE_M:
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
    """Returns the options of the ROS bridge in a `robot.yaml`; empty if it has none.

    Raises `LaunchError` for options that are needed before this file is read.
    """
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
