"""Drives along the wall on the right: a node of ROS 2 without ROS, by the package cyclonedds."""

import os
from dataclasses import dataclass
from types import new_class

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import float32, float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

# Nodes of ROS look for each other on this machine by themselves; a program that speaks DDS is told to.
os.environ["CYCLONEDDS_URI"] = """<CycloneDDS><Domain>
<General><Interfaces><NetworkInterface name="lo"/></Interfaces><AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer Address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""


def message(package: str, name: str, **members: object) -> type:
    """Makes the class of a ROS message: its members, in their order, and its name in DDS."""
    known_as = {"typename": f"{package}.msg.dds_.{name}_"}
    space = {"__annotations__": members, "__module__": __name__}
    return final(dataclass(new_class(name, (IdlStruct,), known_as, lambda made: made.update(space))))


Time = message("builtin_interfaces", "Time", sec=int32, nanosec=uint32)
Header = message("std_msgs", "Header", stamp=Time, frame_id=str)
ANGLES = dict.fromkeys(("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time"), float32)
RANGES = {"range_min": float32, "range_max": float32, "ranges": sequence[float32], "intensities": sequence[float32]}
LaserScan = message("sensor_msgs", "LaserScan", header=Header, **ANGLES, **RANGES)
Vector3 = message("geometry_msgs", "Vector3", x=float64, y=float64, z=float64)
Twist = message("geometry_msgs", "Twist", linear=Vector3, angular=Vector3)

node = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
reliable = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))
scans = DataReader(node, Topic(node, "rt/scan", LaserScan), qos=reliable)  # "rt" begins all names of ROS topics
commands = DataWriter(node, Topic(node, "rt/cmd_vel", Twist), qos=reliable)
for scan in scans.take_iter():
    middle = len(scan.ranges) // 2
    ahead = min(scan.ranges[middle - 30 : middle + 31])
    right = min(scan.ranges[middle - 110 : middle - 40])
    forward, turn = 0.0, 1.0
    if ahead > 0.6:
        forward, turn = min(0.5, 0.5 * ahead), 0.8 * max(-1.0, min(1.0, 0.45 - right))
    commands.write(Twist(linear=Vector3(x=forward, y=0.0, z=0.0), angular=Vector3(x=0.0, y=0.0, z=turn)))
