"""Text of the README at the top of a world export."""

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
| `model.config`, `model.sdf`, `meshes/`, `textures/` | its building: walls, floors, ceilings, as `model://<world>` |
| `<world>.glb` | glTF 2.0 for browsers and other viewers |
| `<world>.usda` (and `textures/`) | USD with UsdPhysics, for Isaac Sim and others |
| `world.xml` (and `textures/`, `meshes/*.obj`) | MJCF for MuJoCo 3.0 to 4.0, mujoco-warp and MJX, see below |
| `world.json` | rooms, walls, passages and furniture with their poses and sizes, seeds, and the result of each wish |
| `world_description.json` | rooms, doors and proofs, for other programs |
| `names.json` | what `world.json` calls things whose names in `world.xml` differ |
| `map.pgm`, `map.yaml` | occupancy grid for Nav2's map server: what a robot 0.4 m high meets |
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

| program | reads `world.xml` |
| --- | --- |
| MuJoCo 3.1 to 4.0 | yes |
| MuJoCo 3.0 | yes; at some angles its contacts of boxes are wrong, and what lies on a table jumps off |
| mujoco-warp, MJX with `impl="warp"` | yes, with the limits below |
| MJX with `impl="jax"` | no: it has no collisions of cylinders with boxes |

Names in `world.xml` are of letters, digits and `_`: `Sofas_1.seat` is `Sofas_1_seat`, `door-1` is `door_1`, as in USD.
`names.json` has the others' names by these.

This is so for worlds whose `generator_version` in `world.json` is 3.2.0 or higher. In those of 3.0.0 to 3.1.1, plates,
cups, and books on round tables creep or jump with MuJoCo before 3.8, whose contacts of flat cylinders are rough. Those
of earlier generators have attributes for sleep, need MuJoCo 3.4 or newer, and keep their names and their map, on which
furniture is as large as its outline.

    python -m mujoco.viewer --mjcf={worlds}/worlds/{example}/world.xml

In Python:

    import mujoco
    model = mujoco.MjModel.from_xml_path("{worlds}/worlds/{example}/world.xml")
    data = mujoco.MjData(model)

All bodies are awake then. From MuJoCo 3.4 on they can sleep until something touches them, which makes steps ten times
faster; it has to be said before `MjData` is made:

    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
    model.tree_sleep_policy[:] = mujoco.mjtSleepPolicy.mjSLEEP_INIT
    data = mujoco.MjData(model)

A robot is added with `mujoco.MjSpec`:

    world = mujoco.MjSpec.from_file("{worlds}/worlds/{example}/world.xml")
    robot = mujoco.MjSpec.from_file("robot.xml")
    world.attach(robot, prefix="robot/", frame=world.worldbody.add_frame())
    model = world.compile()

mujoco-warp does not know sleep, and the limits that it chooses by itself are too small: objects of a furnished house
fall through the floor. These are enough:

    mujoco_warp.put_data(model, data, nworld=1, naconmax=1000, njmax=1000)

`naconmax` counts the contacts of all copies: 160 each were enough for 8,192 copies of a flat and of a dense house on
a GPU (NVIDIA H200), which makes 1.8 and 1.4 million steps a second of them.

## Isaac Sim and other readers of USD

Open `{worlds}/worlds/{example}/{example}.usda`, or reference it: its default prim is `/World`, z is up.
Loose objects are rigid bodies, asleep until something touches them; doors hang on revolute joints. Names of prims
are those of `world.json` with `_` in place of what USD does not take, `displayName` is the name itself.

    import omni.usd
    omni.usd.get_context().open_stage("/absolute/path/to/{example}.usda")

## Nav2

    ros2 run nav2_map_server map_server --ros-args -p yaml_filename:={worlds}/worlds/{example}/map.yaml

The map marks what a robot 0.4 m high meets from 2 cm above the floor, with doors and loose objects as at first: legs of
tables, and not what it drives under. `robomaker world map WORLD FOLDER --robot-height 0.2` writes one for another
height.

## three.js and other viewers

`{example}.glb` has a node for every piece of furniture, named as in `world.json`:

    new GLTFLoader().load("{example}.glb", (gltf) => scene.add(gltf.scene));

Ceilings are drawn from below only, so that one can look into the rooms from above.
"""


def readme(names: list[str]) -> str:
    """Returns the README text of an export archive with the given worlds."""
    count = "one world" if len(names) == 1 else f"{len(names)} worlds"
    return _README.format(count=count, worlds=WORLDS, models=SHARED_MODELS, example=names[0])
