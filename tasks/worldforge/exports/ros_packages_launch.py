"""Launch files of an export; `@FIRST_WORLD@` in them stands for the name of its first world."""

LAUNCH_ROS1 = """\
<?xml version="1.0"?>
<launch>
  <!-- Which world: the argument, else the environment variable WORLD_ID, else the first one of the export. -->
  <arg name="world_id" default="$(optenv WORLD_ID @FIRST_WORLD@)"/>
  <arg name="gui" default="false"/>
  <arg name="paused" default="false"/>
  <arg name="use_sim_time" default="true"/>
  <arg name="debug" default="false"/>
  <arg name="verbose" default="false"/>

  <include file="$(find gazebo_ros)/launch/empty_world.launch">
    <arg name="world_name"
         value="$(find aws_robomaker_worldforge_worlds)/worlds/$(arg world_id)/$(arg world_id).world"/>
    <arg name="gui" value="$(arg gui)"/>
    <arg name="paused" value="$(arg paused)"/>
    <arg name="use_sim_time" value="$(arg use_sim_time)"/>
    <arg name="debug" value="$(arg debug)"/>
    <arg name="verbose" value="$(arg verbose)"/>
  </include>
</launch>
"""

LAUNCH_ROS2 = '''\
"""Starts a generated world in Gazebo.

    ros2 launch aws_robomaker_worldforge_worlds launch_world.py gui:=true world_id:=generation_..._world_1

Which world: the argument world_id, else the environment variable WORLD_ID, else the first one of
the export. With simulator:=auto, Gazebo Sim (ros_gz_sim) is taken where it is installed, else Gazebo
classic (gazebo_ros).
"""

import os

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    IncludeLaunchDescription,
    OpaqueFunction,
    SetEnvironmentVariable,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

FIRST_WORLD = "@FIRST_WORLD@"
WORLDS = "aws_robomaker_worldforge_worlds"
MODELS = "aws_robomaker_worldforge_shared_models"
PATH_VARIABLES = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH")


def share(package):
    """The package's share folder; None if it is not installed."""
    try:
        return get_package_share_directory(package)
    except PackageNotFoundError:
        return None


def gazebo_sim(folder, world, gui, verbose):
    """Gazebo Sim, running at once, with or without its window."""
    flags = ["-r"] + ([] if gui else ["-s"]) + (["-v", "4"] if verbose else [])
    return IncludeLaunchDescription(
        PythonLaunchDescriptionSource(os.path.join(folder, "launch", "gz_sim.launch.py")),
        launch_arguments={"gz_args": " ".join([*flags, world])}.items(),
    )


def gazebo_classic(folder, world, gui, verbose):
    """Gazebo classic, with or without its window."""
    arguments = {"world": world, "gui": str(gui).lower(), "verbose": str(verbose).lower()}
    return IncludeLaunchDescription(
        PythonLaunchDescriptionSource(os.path.join(folder, "launch", "gazebo.launch.py")),
        launch_arguments=arguments.items(),
    )


def start(context):
    """The actions that start the simulator that was asked for."""
    asked = LaunchConfiguration("simulator").perform(context)
    name = LaunchConfiguration("world_id").perform(context)
    gui, verbose = (
        LaunchConfiguration(flag).perform(context).lower() in ("true", "1") for flag in ("gui", "verbose")
    )
    world = os.path.join(get_package_share_directory(WORLDS), "worlds", name, name + ".world")
    if not os.path.isfile(world):
        known = ", ".join(sorted(os.listdir(os.path.join(get_package_share_directory(WORLDS), "worlds"))))
        raise RuntimeError("world_id {!r}: there is no such world; there are {}".format(name, known))
    choices = {"gz": ("ros_gz_sim", gazebo_sim), "gazebo": ("gazebo_ros", gazebo_classic)}
    if asked not in (*choices, "auto"):
        raise RuntimeError("simulator {!r}: expected auto, gz or gazebo".format(asked))
    for choice in choices if asked == "auto" else (asked,):
        package, action = choices[choice]
        folder = share(package)
        if folder:
            return [action(folder, world, gui, verbose)]
    raise RuntimeError("simulator {!r}: neither ros_gz_sim nor gazebo_ros is installed".format(asked))


def generate_launch_description():
    """What `ros2 launch` asks for."""
    folders = [
        os.path.join(get_package_share_directory(MODELS), "models"),
        os.path.join(get_package_share_directory(WORLDS), "worlds"),
    ]
    paths = {
        variable: os.pathsep.join(folders + [path for path in [os.environ.get(variable)] if path])
        for variable in PATH_VARIABLES
    }
    return LaunchDescription(
        [SetEnvironmentVariable(variable, path) for variable, path in paths.items()]
        + [
            DeclareLaunchArgument("world_id", default_value=os.environ.get("WORLD_ID") or FIRST_WORLD),
            DeclareLaunchArgument("gui", default_value="false"),
            DeclareLaunchArgument("verbose", default_value="false"),
            DeclareLaunchArgument("simulator", default_value="auto", description="auto, gz or gazebo"),
            OpaqueFunction(function=start),
        ]
    )
'''
