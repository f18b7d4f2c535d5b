"""The simulation application: two rooms, a rug before the sliding door between them, and a robot on two wheels."""

# dm_control has no types, so overriding its methods looks wrong to a type checker.
# pyright: reportIncompatibleMethodOverride=false

import math

import dm_env.specs
import mujoco
import numpy as np
from dm_control.mujoco import Physics
from dm_control.rl import control

from prefect_robomaker.tasks.runtime.axes.imperfections import LidarErrors

DOOR_X_M, GOAL_X_M = 2.5, 3.5
DOORWAY_M = 0.9
OPENINGS_M = {"open": DOORWAY_M, "half shut": 0.5}
"""Width that the two leaves of the sliding door leave free; the robot is 0.36 m wide."""
LIGHTS = {"day": 1.0, "night": 0.02}
RUG_M = (0.6, 2.2)
"""The rug, from the start towards the door."""
PILE_N = 3.6
"""Push of the rug's pile along its grain. Makers of vacuum cleaners know it as carpet drift: tyres creep sideways."""
DRAG_N = 1.5
CREEP_NS_PER_M = 80.0
"""Force at which tyres creep by 1 m/s: on the rug, by 4 cm/s to the side at most."""
TICK_STD_M = 0.0007
"""Error of what the encoders of the wheels count in one control step."""
PIXELS = np.linspace(math.radians(35), math.radians(-35), 48)
"""Directions of the pixels of the camera, which sees one line; from left to right, straight on is 0."""
PIXEL_STD = 0.02
"""Noise of a pixel; 1 is a white wall by day."""
RAYS = np.linspace(math.radians(45), math.radians(-45), 91)
"""Directions of the lidar's rays, from left to right."""

MODEL = """
<mujoco model="house">
  <option timestep="0.01" gravity="0 0 0"/>
  <worldbody>
    <light pos="1 0 4"/>
    <camera name="above" pos="1.6 0 5" xyaxes="0 -1 0 1 0 0"/>
    <geom name="floor" type="plane" size="6 6 .1" rgba=".6 .6 .6 1"/>
    {rug}
    <geom name="post left" type="box" pos="{door} 2.225 .5" size=".05 1.775 .5" rgba=".5 .5 .5 1"/>
    <geom name="post right" type="box" pos="{door} -2.225 .5" size=".05 1.775 .5" rgba=".5 .5 .5 1"/>
    <geom name="leaf left" type="box" pos="{door} {leaf} .5" size=".02 .45 .5" rgba=".4 .4 .4 1"/>
    <geom name="leaf right" type="box" pos="{door} -{leaf} .5" size=".02 .45 .5" rgba=".4 .4 .4 1"/>
    <geom name="far wall" type="box" pos="4.5 0 .5" size=".05 4 .5" rgba="1 1 1 1"/>
    <body name="courier" pos="0 0 .12">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0"/>
      <joint name="yaw" type="hinge" axis="0 0 1"/>
      <geom name="hull" type="cylinder" size=".18 .1" mass="4" rgba=".2 .4 .8 1"/>
    </body>
  </worldbody>
  <actuator>
    <velocity name="x" joint="x" kv="{creep}" forcelimited="true" forcerange="-30 30"/>
    <velocity name="y" joint="y" kv="{creep}" forcelimited="true" forcerange="-30 30"/>
    <velocity name="yaw" joint="yaw" kv="4"/>
  </actuator>
</mujoco>
"""
RUG = '<geom name="rug" type="box" pos="1.4 0 .002" size=".8 1.5 .002" rgba=".6 .3 .3 1" contype="0" conaffinity="0"/>'


def model(floor: str, door: str) -> str:
    """Writes the MuJoCo model of the house."""
    leaf = OPENINGS_M[door] / 2 + 0.45
    return MODEL.format(rug=RUG if floor == "carpet" else "", door=DOOR_X_M, leaf=leaf, creep=CREEP_NS_PER_M)


class Errand(control.Task):
    """Drive to the middle of the next room."""

    def __init__(self, rng: np.random.Generator, floor: str, light: str) -> None:
        self._rng = rng
        self._carpet = floor == "carpet"
        self._light = LIGHTS[light]
        self.lidar_errors = LidarErrors(noise_std_m=0.005)

    def initialize_episode(self, physics: Physics):
        """Puts the robot at its place, within a hand's breadth, and lays the rug with its grain somehow."""
        # One draw after the other, whatever the axes are: trials of one seed differ in their axes alone.
        start_y, start_yaw, grain = self._rng.uniform([-0.1, -0.1, 0.3], [0.1, 0.1, 1.0])
        side = self._rng.choice([-1.0, 1.0])
        physics.named.data.qpos["y"], physics.named.data.qpos["yaw"] = start_y, start_yaw
        self._pile = side * grain * PILE_N
        self._told = np.array([0.0, start_y, start_yaw])
        self._command = np.zeros(2)

    def before_step(self, action: np.ndarray, physics: Physics):
        """Turns the wheels, and lets the rug push and hold back what drives over it."""
        self._command = np.clip(action, [-0.1, -1.5], [0.5, 1.5])
        speed, turn = self._command
        x, _, yaw = physics.data.qpos
        physics.set_control([speed * math.cos(yaw), speed * math.sin(yaw), turn])
        on_rug = self._carpet and RUG_M[0] < x < RUG_M[1] and speed > 0
        physics.data.qfrc_applied[:2] = (-DRAG_N, self._pile) if on_rug else (0.0, 0.0)

    def after_step(self, physics: Physics):
        """Counts what the wheels have turned: that is all that the encoders know."""
        _, _, yaw = self._told
        way = self._command[0] * self.control_timestep_s + self._rng.normal(0, TICK_STD_M)
        self._told += way * math.cos(yaw), way * math.sin(yaw), self._command[1] * self.control_timestep_s

    control_timestep_s = 0.1

    def get_observation(self, physics: Physics):
        """Returns the odometry, the picture and the scan."""
        _, geoms = look(physics, PIXELS)
        seen = np.where(geoms >= 0, physics.model.geom_rgba[geoms, 0], 0.0) * self._light
        scan, _ = look(physics, RAYS)
        return {
            "time": physics.data.time,
            "odometry": self._told.copy(),
            "picture": seen + self._rng.normal(0, PIXEL_STD, len(PIXELS)),
            "scan": self.lidar_errors.disturb(scan, self._rng, self._rng),
        }

    def get_reward(self, physics: Physics):
        """Returns 0: the job's requirements judge."""
        return 0.0

    def action_spec(self, physics: Physics):
        """Returns the spec of the action: speed in m/s and turning rate in rad/s."""
        return dm_env.specs.BoundedArray((2,), float, [-0.1, -1.5], [0.5, 1.5], "speed and turning rate")


def look(physics: Physics, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns how far one sees from the robot in some directions, in m (infinite: nothing), and the geoms there."""
    x, y, yaw = physics.data.qpos
    angles = directions + yaw
    rays = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
    reach, geoms = np.zeros(len(angles)), np.zeros(len(angles), np.int32)
    own = physics.model.name2id("courier", "body")
    mujoco.mj_multiRay(
        physics.model.ptr, physics.data.ptr, np.array([x, y, 0.15]), rays.ravel(), None, 1, own, geoms, reach, None,
        len(angles), 10.0,
    )  # fmt: skip
    return np.where(geoms >= 0, reach, np.inf), geoms


class House(control.Environment):
    """Environment whose lidar can be made worse by axes of trials."""

    robot_body = "courier"
    video_camera = "above"

    @property
    def lidar_errors(self) -> LidarErrors:
        """Errors of the lidar."""
        return self.task.lidar_errors


def make_environment(context) -> House:
    """Makes the house: FLOOR is tiles or carpet, LIGHT day or night, DOOR open or half shut."""
    floor, light, door = (
        context.environment.get(name, usual) for name, usual in (("FLOOR", "tiles"), ("LIGHT", "day"), ("DOOR", "open"))
    )
    task = Errand(context.rng, floor, light)
    physics = Physics.from_xml_string(model(floor, door))
    return House(physics, task, time_limit=30, control_timestep=task.control_timestep_s, legacy_step=False)
