"""Text files of the exported ROS packages, with which ROS 1, ROS 2 and Gazebo find the models and worlds."""

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


SHARED_MODELS = "aws_robomaker_worldforge_shared_models"
WORLDS = "aws_robomaker_worldforge_worlds"

_VERSION = "1.0.0"

_PACKAGE_XML = """\
<?xml version="1.0"?>
<?xml-model href="http://download.ros.org/schema/package_format3.xsd" schematypens="http://www.w3.org/2001/XMLSchema"?>
<package format="3">
  <name>{name}</name>
  <version>{version}</version>
  <description>{description}</description>
  <maintainer email="owner@example.com">The owner of these worlds</maintainer>
  <license>Proprietary</license>

  <buildtool_depend condition="$ROS_VERSION == 1">catkin</buildtool_depend>
  <buildtool_depend condition="$ROS_VERSION == 2">ament_cmake</buildtool_depend>
{depends}
  <export>
    <gazebo_ros gazebo_model_path="${{prefix}}/{folder}"/>
    <build_type condition="$ROS_VERSION == 1">catkin</build_type>
    <build_type condition="$ROS_VERSION == 2">ament_cmake</build_type>
  </export>
</package>
"""
# Only packages that depend on gazebo_ros are asked for their gazebo_model_path in ROS 1. In ROS 2 no
# simulator is named: Gazebo classic ended with Humble, and either may be the installed one.
_SHARED_DEPENDS = """\
  <exec_depend condition="$ROS_VERSION == 1">gazebo_ros</exec_depend>
"""
_WORLDS_DEPENDS = """\
  <exec_depend>aws_robomaker_worldforge_shared_models</exec_depend>
  <exec_depend condition="$ROS_VERSION == 1">gazebo_ros</exec_depend>
  <exec_depend condition="$ROS_VERSION == 1">roslaunch</exec_depend>
  <exec_depend condition="$ROS_VERSION == 2">launch</exec_depend>
  <exec_depend condition="$ROS_VERSION == 2">ament_index_python</exec_depend>
"""

_CMAKE = """\
cmake_minimum_required(VERSION 3.5)
project({name})

# ROS sets ROS_VERSION; without it, whichever of the two build systems is there is taken.
if("$ENV{{ROS_VERSION}}" STREQUAL "1")
  find_package(catkin REQUIRED)
elseif("$ENV{{ROS_VERSION}}" STREQUAL "2")
  find_package(ament_cmake REQUIRED)
else()
  find_package(ament_cmake QUIET)
  if(NOT ament_cmake_FOUND)
    find_package(catkin REQUIRED)
  endif()
endif()

if(ament_cmake_FOUND)
  install(DIRECTORY {folders} DESTINATION share/${{PROJECT_NAME}})
  ament_environment_hooks(
    "${{CMAKE_CURRENT_SOURCE_DIR}}/env-hooks/${{PROJECT_NAME}}.sh.in"
    "${{CMAKE_CURRENT_SOURCE_DIR}}/env-hooks/${{PROJECT_NAME}}.dsv.in")
  ament_package()
else()
  catkin_package()
  catkin_add_env_hooks(50.${{PROJECT_NAME}} SHELLS sh DIRECTORY ${{CMAKE_CURRENT_SOURCE_DIR}}/env-hooks)
  install(DIRECTORY {folders} DESTINATION ${{CATKIN_PACKAGE_SHARE_DESTINATION}})
endif()
"""

PATH_VARIABLES = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH")
"""Environment variables with which Gazebo classic, Gazebo Sim, Ignition Gazebo and libsdformat find `model://`."""


def package_files(worlds: list[str]) -> dict[str, str]:
    """Returns the text files of the exported ROS packages (launch files, manifests), by path.

    Args:
        worlds: Names of the worlds in archives; the first is launched unless another is asked for.
    """
    shared = _package(
        SHARED_MODELS,
        "models",
        "Models of furniture, objects and doors that generated worlds share.",
        _SHARED_DEPENDS,
        ["models"],
    )
    own = _package(WORLDS, "worlds", "Generated worlds.", _WORLDS_DEPENDS, ["launch", "worlds"])
    own |= {
        f"{WORLDS}/launch/launch_world.launch": LAUNCH_ROS1.replace("@FIRST_WORLD@", worlds[0]),
        f"{WORLDS}/launch/launch_world.py": LAUNCH_ROS2.replace("@FIRST_WORLD@", worlds[0]),
    }
    return shared | own


def _package(name: str, folder: str, description: str, depends: str, folders: list[str]) -> dict[str, str]:
    about = {"name": name, "version": _VERSION, "description": description, "depends": depends, "folder": folder}
    return {
        f"{name}/package.xml": _PACKAGE_XML.format(**about),
        f"{name}/CMakeLists.txt": _CMAKE.format(name=name, folders=" ".join(folders)),
        f"{name}/README.md": f"# {name}\n\n{description} `../README.md` tells how to use them.\n",
        f"{name}/env-hooks/{name}.sh.in": _ament_sh(folder),
        f"{name}/env-hooks/{name}.dsv.in": _ament_dsv(folder),
        f"{name}/env-hooks/50.{name}.sh.em": _catkin_sh(folder),
    }


def _ament_sh(folder: str) -> str:
    return "".join(
        f'ament_prepend_unique_value {variable} "$AMENT_CURRENT_PREFIX/share/@PROJECT_NAME@/{folder}"\n'
        for variable in PATH_VARIABLES
    )


def _ament_dsv(folder: str) -> str:
    return "".join(f"prepend-non-duplicate;{variable};share/@PROJECT_NAME@/{folder}\n" for variable in PATH_VARIABLES)


def _catkin_sh(folder: str) -> str:
    """Returns a catkin environment hook that sets the search paths.

    catkin expands it with empy, for the source and the install folder.
    """
    lines = [
        "@[if DEVELSPACE]@",
        f'_worldforge_folder="@(CMAKE_CURRENT_SOURCE_DIR)/{folder}"',
        "@[else]@",
        f'_worldforge_folder="$CATKIN_ENV_HOOK_WORKSPACE/@(CATKIN_PACKAGE_SHARE_DESTINATION)/{folder}"',
        "@[end if]@",
    ]
    for variable in PATH_VARIABLES:
        # Sourcing a workspace twice must not name the folder twice.
        lines += [
            f'case ":${variable}:" in',
            '  *":$_worldforge_folder:"*) ;;',
            f'  *) export {variable}="$_worldforge_folder${{{variable}:+:${variable}}}" ;;',
            "esac",
        ]
    return "\n".join([*lines, "unset _worldforge_folder", ""])
