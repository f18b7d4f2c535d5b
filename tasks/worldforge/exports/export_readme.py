"""The README at the top of an export."""

from .ros_packages import SHARED_MODELS, WORLDS

_README = """\
# Exported worlds

This archive holds {count}, as two packages for ROS 1 and ROS 2. `index.json` lists every file with its
size and SHA-256.

| folder | what it is |
| --- | --- |
| `{worlds}/worlds/<world>/` | one world |
| `{models}/models/<model>/` | furniture, objects and doors that worlds share as `model://<model>` |

The files of a world:

| file | what it is |
| --- | --- |
| `<world>.world` | SDF 1.6 for Gazebo 9, 11 and Gazebo Sim |
| `model.config`, `model.sdf`, `meshes/`, `materials/` | its building: walls, floors, ceilings, as `model://<world>` |
| `<world>.glb` | glTF 2.0 for browsers and other viewers |
| `world.xml` (and `textures/`) | MJCF for MuJoCo 3 |
| `world.json` | rooms, walls, passages and furniture with their poses and sizes, seeds, and the result of each wish |
| `world_description.json` | rooms, doors and proofs, for other programs |
| `map.pgm`, `map.yaml` | occupancy grid for Nav2's map server |
| `floorplan.svg`, `preview.png` | the plan with names, and the furnished world from above |

Lengths are metres, angles radians; x points east, y north, z up (in GLB, y is up and z south); the floor is z = 0,
and a cylinder of 1 m diameter at the origin is free. Furniture is static; loose objects can be pushed;
doors turn on hinges.

## ROS 2

    mkdir -p ~/ws/src && unzip -d ~/ws/src ARCHIVE.zip && cd ~/ws && colcon build && . install/setup.sh
    ros2 launch {worlds} launch_world.py gui:=true

It takes Gazebo Sim (`ros_gz_sim`) or Gazebo classic (`gazebo_ros`), whichever is installed. `world_id:=<world>`
or the environment variable `WORLD_ID` choose the world; the first one is `{example}`.

## ROS 1

    mkdir -p ~/ws/src && unzip -d ~/ws/src ARCHIVE.zip && cd ~/ws && catkin_make && . devel/setup.sh
    WORLD_ID={example} roslaunch {worlds} launch_world.launch gui:=true

## Gazebo without ROS

From this folder:

    export GAZEBO_MODEL_PATH=$PWD/{models}/models:$PWD/{worlds}/worlds
    gazebo {worlds}/worlds/{example}/{example}.world

Gazebo Sim reads `GZ_SIM_RESOURCE_PATH` instead, and is started with `gz sim`.

## MuJoCo

    python -m mujoco.viewer --mjcf={worlds}/worlds/{example}/world.xml

In Python:

    import mujoco
    model = mujoco.MjModel.from_xml_path("{worlds}/worlds/{example}/world.xml")
    data = mujoco.MjData(model)

A robot is added with `mujoco.MjSpec`:

    world = mujoco.MjSpec.from_file("{worlds}/worlds/{example}/world.xml")
    robot = mujoco.MjSpec.from_file("robot.xml")
    world.attach(robot, prefix="robot/", frame=world.worldbody.add_frame())
    model = world.compile()

## Nav2

    ros2 run nav2_map_server map_server --ros-args -p yaml_filename:={worlds}/worlds/{example}/map.yaml

## three.js and other viewers

`{example}.glb` has a node for every piece of furniture, named as in `world.json`:

    new GLTFLoader().load("{example}.glb", (gltf) => scene.add(gltf.scene));

Ceilings are drawn from below only, so that one can look into the rooms from above.
"""


def readme(names: list[str]) -> str:
    """The text for worlds of these names in archives."""
    count = "one world" if len(names) == 1 else f"{len(names)} worlds"
    return _README.format(count=count, worlds=WORLDS, models=SHARED_MODELS, example=names[0])
