"""The scene that requirements are measured in where a run was recorded: topics in place of physics."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.recording_sources import RecordingSources
from ....schemas.runs.requirement_kinds.kind import NotMeasuredError, Rule
from ....schemas.worlds.world import World
from ..episode.floor import MapFloor, floor_of
from ..episode.loading import load_judging_function
from .bags import Bag, Message, RecordingFault
from .frames import FrameTree
from .sources import (
    CONTACT_TYPES,
    MARKERS,
    POSE_TYPES,
    SCAN_TYPE,
    TRANSFORMS,
    Contacts,
    Pose,
    PoseTopic,
    Scan,
    Source,
    TransformPoses,
    fits_floor,
)

CLOCK = "/clock"
_TF, _TF_STATIC, _ODOM, _SCAN, _CONTACTS = "/tf", "/tf_static", "/odom", "/scan", "/contacts"
_ODOM_FRAME = "odom"
_BASES = ("base_link", "base_footprint")
_MAX_SHOWN = 12


_ASKS_FOR_MESSAGES = ("min_hz", "max_gap_s")
"""Members of requirements that silence violates, so that what was lost lets none pass."""


class Measurements:
    """All measurements of a robot in a ROS recording: pose, contacts and lidar distances.

    Explicit topics have to be there; the usual ones need not, and a requirement that needs one is an error then.
    """

    def __init__(self, bag: Bag, sources: RecordingSources, losses: Mapping[str, str] | None = None) -> None:
        """Finds the topics.

        Args:
            bag: The recording.
            sources: Which topics are which.
            losses: Why topics are not recorded whole, by their names.

        Raises:
            RecordingFault: A topic that is named is not there, or has a type that says nothing of it.
        """
        self._bag, self.sources, self._losses = bag, sources, losses or {}
        self._read: list[tuple[Rule[Any], str]] = []
        """Rules that take silence for good, and the topic that each reads."""
        self._tree = FrameTree()
        self._is_tf = _TF in bag.types and bool(bag.types[_TF] & set(TRANSFORMS))
        for message in bag.messages([_TF_STATIC]) if bag.types.get(_TF_STATIC, set()) & set(TRANSFORMS) else ():
            for transform in message.content.transforms:
                self._tree.place(transform, is_static=True)
        self._unseen: Iterator[Message] = bag.messages([_TF]) if self._is_tf else iter(())
        self._transforms = TransformPoses(self._tree, sources)
        self._poses: dict[int, Pose] = {}
        """Poses that rules are about, by the rule's identity."""
        self._tilted: list[tuple[Rule[Any], Pose]] = []
        self._topic_pose = self._find_pose_topic()
        self._contacts = self._find_contacts()
        self._scan = self._find_scan()

    @property
    def topics(self) -> list[str]:
        """Topics whose messages are read."""
        _ = self._chosen  # a topic that `/tf` makes needless is not read
        found = [_TF] if self._is_tf else []
        found += [self._topic_pose.source.name] if self._topic_pose else []
        found += self._contacts.topics if self._contacts else []
        return [*found, *([self._scan.topic] if self._scan else [])]

    def is_pose(self, topic: str) -> bool:
        """Whether a topic contains poses, which are also read from before the run."""
        return topic == _TF or (self._topic_pose is not None and topic == self._topic_pose.source.name)

    def take(self, message: Message, time_s: float) -> None:
        """Reads a message; before the run began, only poses are used."""
        topic = message.topic
        if topic == _TF:
            self._transforms.take(message, time_s, self._bag.path)
        if self._topic_pose is not None and topic == self._topic_pose.source.name:
            self._topic_pose.take(message, time_s, self._bag.path)
        if time_s < 0:
            return
        if self._scan is not None and topic == self._scan.topic:
            self._scan.take(message, time_s, self._bag.path)
        if self._contacts is not None and topic in self._contacts.topics:
            self._contacts.take(message, time_s)

    def look_back(self, time_s: float) -> None:
        """Records which topics have been silent for too long."""
        for source in self._steady_sources():
            source.look_back(time_s)
        if self._contacts is not None:
            self._contacts.look_back(time_s)

    def finish(self, end_s: float) -> None:
        """Records which sources were silent at the end."""
        for source in self._steady_sources():
            source.finish(end_s)
        for rule, pose in self._tilted:
            if not pose.tilts and rule.violated_s is None:
                names = ", ".join(source.name for source in pose.sources)
                rule.fail(f"poses of {names} are never tilted in the least, as those of wheels, so it could be missed")
        if self._contacts is not None:
            self._contacts.finish(end_s)
        if self._scan is not None:
            self._scan.finish()
        felt = self._contacts.sources if self._contacts else []
        for rule, topic in [*self._read, *((rule, source.name) for source in felt for rule in source.rules)]:
            if topic in self._losses and rule.violated_s is None:
                rule.fail(f"{topic}: {self._losses[topic]}, so something could have been missed")

    def note_reader(self, rule: Rule[Any], topic: str) -> None:
        """Takes note that a rule reads a topic whose silence would be good."""
        self._read.append((rule, topic))

    def remarks(self) -> list[str]:
        """Returns notes on how the run was measured, for people who read the verdict."""
        found = list(self._contacts.remarks()) if self._contacts else []
        if self.pose is None or not any(source.rules for source in self.pose.sources):
            return found
        frame = self._topic_pose.frame if self._topic_pose else self._root
        if frame and frame != self.sources.map_frame:
            name = self.pose.sources[0].name
            found.append(f"positions are those of {name} in the frame {frame!r}, which may drift from the map")
        return found

    def _steady_sources(self) -> list[Source]:
        """Sources whose silence is a gap, each once."""
        poses = [self.pose, *self._bodies.values()]
        found = {id(source): source for pose in poses if pose is not None for source in pose.sources}
        return [*found.values(), *([self._scan.source] if self._scan is not None else [])]

    # Things that rules ask for

    @cached_property
    def _bodies(self) -> dict[str, Pose]:
        """Poses of frames that requirements name as a `body`."""
        return {}

    def pose_of(self, rule: Rule[Any]) -> Pose:
        """Returns the pose that a requirement's rule is about.

        Raises:
            NotMeasuredError: The recording does not have it.
        """
        body = getattr(rule.asked, "body", None)
        pose = self.pose if body is None or body in (self.base, "") else self._bodies.get(body)
        if pose is None and body is not None and body != self.base:
            chain = self._chain(self.sources.map_frame, body) or self._chain(_ODOM_FRAME, body)
            pose = self._bodies[body] = self._transforms.pose(chain) if chain else None  # pyright: ignore[reportArgumentType]
            if pose is None:
                del self._bodies[body]
                raise NotMeasuredError(
                    f"{self._bag.path.name} has no frame {body!r} on {_TF}, whose pose would be measured"
                )
        if pose is None:
            raise NotMeasuredError(self._no_pose())
        if not pose.sources:
            raise NotMeasuredError(
                f"{self._bag.path.name}: all frames from the map to {body or self.base!r} are on {_TF_STATIC}, so it "
                "could not move"
            )
        if self._poses.get(id(rule)) is not pose:
            self._poses[id(rule)] = pose
            for source in pose.sources:
                source.rules.append(rule)
        return pose

    def expect_tilt(self, rule: Rule[Any]) -> None:
        """Takes note that a rule is about tilt, which planar poses do not tell."""
        self._tilted.append((rule, self.pose_of(rule)))

    def is_ready(self, rule: Rule[Any]) -> bool:
        """Whether all that a rule measures by has been heard."""
        pose = self._poses.get(id(rule))
        scanned = self._scan is None or rule not in self._scan.source.rules or self._scan.source.messages > 0
        return scanned and (pose is None or pose.is_known)

    def contacts(self, rule: Rule[Any]) -> Callable[[], Mapping[str, float]]:
        """Makes a function that returns the contact forces of objects that touch the robot.

        Raises:
            NotMeasuredError: The recording has no topic with contacts, or it is not said which side is the robot.
        """
        if self._contacts is None:
            raise NotMeasuredError(
                f"{self._bag.path.name} has no topic with contacts (gazebo_msgs/ContactsState, "
                f"ros_gz_interfaces/Contacts, or {_CONTACTS} of our own recordings), so it cannot say "
                "what was touched; record a contact sensor"
            )
        others = [topic for topic in self._contacts.topics if MARKERS not in self._bag.types[topic]]
        if others and self.sources.robot is None:
            raise NotMeasuredError(
                f"contacts on {others[0]} name models; say which is the robot's (robot in the sources)"
            )
        if others and fits_floor(self.sources.robot or ""):
            raise NotMeasuredError(
                f"robot is {self.sources.robot!r}, which the floor is called as well, so nothing could be touched; the "
                "name of the robot's model would do"
            )
        return self._contacts.reader(rule)

    def clearance(self, rule: Rule[Any]) -> Callable[[float], tuple[float, str] | None]:
        """Makes a function that returns the distance to obstacles from the lidar.

        Raises:
            NotMeasuredError: The recording has no scan, the robot's radius is not known, or names count.
        """
        if self._scan is None:
            there = self._bag.topics_of(SCAN_TYPE)
            which = f"; it has {', '.join(there)}, name one (scan in the sources)" if there else "; record one"
            raise NotMeasuredError(f"{self._bag.path.name} has no topic {_SCAN} ({SCAN_TYPE}){which}")
        if self.sources.radius_m is None:
            raise NotMeasuredError(
                f"clearance by {self._scan.topic} needs the robot's radius (radius_m in the sources)"
            )
        if (body := getattr(rule.asked, "body", None)) not in (None, "", self.base):
            raise NotMeasuredError(
                f"{self._scan.topic} tells the distance from the robot as a circle around {self.base!r}, and not from "
                f"{body!r}; leave out body"
            )
        for member in ("others", "ignore"):
            if getattr(rule.asked, member, None):
                raise NotMeasuredError(
                    f"{self._scan.topic} has no names of things, so {member} cannot be told from others"
                )
        return self._scan.meter(rule)

    # Which topics are which

    @cached_property
    def base(self) -> str:
        """Name of the frame of the robot's base."""
        if self.sources.base_frame is not None:
            return self.sources.base_frame
        for frame in _BASES:
            self._chain(self.sources.map_frame, frame)  # reads until it is there
            if frame in self._tree.parents:
                return frame
        return _BASES[0]

    @cached_property
    def _chosen(self) -> tuple[Pose | None, str]:
        """The robot's pose, and the frame that it is in."""
        wanted, root = self.sources.pose, self.sources.map_frame
        if self._topic_pose is not None and wanted is not None:
            return self._topic_pose.pose, ""
        if chain := self._chain(root, self.base):
            self._topic_pose = None
            return self._transforms.pose(chain), root
        if self._topic_pose is not None:
            return self._topic_pose.pose, ""
        chain = self._chain(_ODOM_FRAME, self.base)
        return (self._transforms.pose(chain), _ODOM_FRAME) if chain else (None, "")

    @property
    def pose(self) -> Pose | None:
        """Pose of the robot's base; `None` if the recording does not have it."""
        return self._chosen[0]

    @property
    def _root(self) -> str:
        return self._chosen[1]

    def _chain(self, root: str, frame: str) -> list[str] | None:
        """Frames that lead from a root to a frame; reads `/tf` ahead until they are known."""
        while (found := self._tree.chain(root, frame)) is None:
            message = next(self._unseen, None)
            if message is None:
                return None
            for transform in message.content.transforms:
                self._tree.know(transform, is_static=False)
        return found

    def _no_pose(self) -> str:
        sources = self.sources
        where = f"{self._bag.path.name} does not say where the robot is"
        if sources.pose == _TF or self._is_tf:
            frames = ", ".join(sorted({*self._tree.parents, *self._tree.parents.values()})[:_MAX_SHOWN]) or "none"
            return (
                f"{where}: {_TF} does not lead from {sources.map_frame!r} or {_ODOM_FRAME!r} to {self.base!r} (it has "
                f"{frames}), and there is no topic {_ODOM}"
            )
        there = self._bag.topics_of(*POSE_TYPES)
        which = f"; {', '.join(there)} may (pose in the sources)" if there else ""
        return f"{where}: it has neither {_TF} nor {_ODOM}{which}"

    def _find_pose_topic(self) -> PoseTopic | None:
        wanted = self.sources.pose
        if wanted == _TF:
            self._check(_TF, TRANSFORMS, "pose")
            return None
        if wanted is not None:
            self._check(wanted, POSE_TYPES, "pose")
            return PoseTopic(wanted, self.sources)
        has_odom = _ODOM in self._bag.types and bool(self._bag.types[_ODOM] & set(POSE_TYPES))
        return PoseTopic(_ODOM, self.sources) if has_odom else None

    def _find_contacts(self) -> Contacts | None:
        for topic in self.sources.contacts:
            self._check(topic, tuple(CONTACT_TYPES), "contacts")
        own = [_CONTACTS] if MARKERS in self._bag.types.get(_CONTACTS, ()) else []
        usual = [*self._bag.topics_of(*(each for each in CONTACT_TYPES if each != MARKERS)), *own]
        topics = self.sources.contacts or list(dict.fromkeys(usual))
        return Contacts(topics, self._bag.types, self.sources) if topics else None

    def _find_scan(self) -> Scan | None:
        wanted = self.sources.scan
        if wanted is not None:
            self._check(wanted, (SCAN_TYPE,), "scan")
        else:
            there = self._bag.topics_of(SCAN_TYPE)
            wanted = _SCAN if _SCAN in there else there[0] if len(there) == 1 else None
        return Scan(wanted, self._tree, self.base, self.sources) if wanted else None

    def _check(self, topic: str, types: Sequence[str], member: str) -> None:
        """Refuses a topic that is named and cannot be what it is named for.

        Raises:
            RecordingFault: It is not in the recording, or has another type.
        """
        found = self._bag.type_of(topic)
        if found not in types:
            raise RecordingFault(
                f"{self._bag.path}: {member} is {topic}, whose type is {found}; {', '.join(types)} would be right"
            )


class TopicScene:
    """Scene for judging requirements by a ROS recording instead of a physics simulation."""

    def __init__(
        self,
        environment: Any,
        measurements: Measurements,
        plan: RunPlan,
        read_world: Callable[[], World | None],
        *,
        calls_functions: bool,
    ) -> None:
        """Prepares the scene.

        Args:
            environment: The environment that plays the recording.
            measurements: What it tells.
            plan: The run.
            read_world: Reads the world, where there is one.
            calls_functions: Whether functions of applications are called, which is code of the user's.
        """
        self.environment = environment
        self._measurements, self._plan, self._read_world = measurements, plan, read_world
        self._calls_functions = calls_functions

    @property
    def world(self) -> World | None:
        """World that the robot was in."""
        return self._read_world()

    def position(self, rule: Rule[Any]) -> Sequence[float]:
        """Returns the robot's position x, y, z in metres, as a sequence that follows the recording."""
        return self._measurements.pose_of(rule).position

    def orientation(self, rule: Rule[Any]) -> Sequence[float]:
        """Returns the robot's orientation (quaternion, w first), as a sequence that follows the recording."""
        return self._measurements.pose_of(rule).orientation

    def can_tilt(self, rule: Rule[Any]) -> bool:
        """Whether it can be tilted; poses that never are in the least are an error at the end."""
        self._measurements.expect_tilt(rule)
        return True

    def is_ready(self, rule: Rule[Any]) -> bool:
        """Whether all that the rule measures by has been heard."""
        return self._measurements.is_ready(rule)

    def floor(self, rule: Rule[Any]) -> MapFloor | None:
        """The floor of the world, from its map; `None`: there is no world."""
        return floor_of(self._plan, rule)

    def messages(self, rule: Rule[Any], topic: str) -> Iterator[tuple[float, Any]]:
        """Messages on a topic, each with its time in s.

        Raises:
            NotMeasuredError: The recording has no such topic.
        """
        if all(getattr(rule.asked, each, None) is None for each in _ASKS_FOR_MESSAGES):
            self._measurements.note_reader(rule, topic)
        return self.environment.messages_on(topic)

    def contacts(self, rule: Rule[Any]) -> Callable[[], Mapping[str, float]]:
        """Makes a function that returns the contact forces (N) since its last call, by object."""
        return self._measurements.contacts(rule)

    def clearance(self, rule: Rule[Any]) -> Callable[[float], tuple[float, str] | None]:
        """Makes a function that returns the smallest distance in metres since its last call."""
        return self._measurements.clearance(rule)

    def function(self, rule: Rule[Any], attribute: str) -> Callable[..., Any]:
        """Imports a predicate function of an installed package or of the job's applications.

        Raises:
            NotMeasuredError: Functions are not called here.
            RequirementError: There is no such function.
        """
        if not self._calls_functions:
            raise NotMeasuredError(
                f"{attribute} is a function, which is not called for a job of programs; `robomaker judge` calls it"
            )
        return load_judging_function(self._plan, rule, attribute)

    def __getattr__(self, name: str) -> Any:
        """Measurements that kinds of requirements need and no topic has yet: an error of that requirement."""
        if name.startswith("_"):
            raise AttributeError(name)

        def missing(*_arguments: object, **_options: object) -> Any:
            raise NotMeasuredError(f"{name} is measured in simulations only, and not in a recording")

        return missing
