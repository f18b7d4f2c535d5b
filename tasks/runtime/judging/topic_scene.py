"""Scene in which requirements are measured on a ROS recording, with topics instead of physics."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.recording_sources import RecordingSources
from ....schemas.runs.requirement_kinds.kind import NotMeasuredError, PosePair, Rule
from ....schemas.worlds.world import World
from ..episode.floor import MapFloor, floor_of
from ..episode.loading import load_judging_function
from .bags import Bag, Message, RecordingFault
from .contacts import CONTACT_TYPES, MARKERS, Contacts, fits_floor, listed_names
from .frames import FrameTree
from .pose_pairs import PosePairs, Timed, poses_in, poses_on
from .poses import POSE_TYPES, TRANSFORMS, Pose, PoseTopic, TransformPoses
from .scan_clearance import SCAN_TYPE, Scan
from .silences import Source

CLOCK = "/clock"
_TF, _TF_STATIC, _ODOM, _SCAN, _CONTACTS = "/tf", "/tf_static", "/odom", "/scan", "/contacts"
_ODOM_FRAME = "odom"
_BASES = ("base_link", "base_footprint")
_MAX_SHOWN = 12


_ASKS_FOR_MESSAGES = ("min_hz", "max_gap_s")
"""Fields of requirements that a silent topic violates; if messages were lost, such a requirement cannot pass."""


class Measurements:
    """All measurements of a robot in a ROS recording: pose, contacts and lidar distances.

    Topics that are set explicitly must exist. A missing default topic is only an error of requirements that need it.
    """

    def __init__(self, bag: Bag, sources: RecordingSources, losses: Mapping[str, str] | None = None) -> None:
        """Finds the topics of a ROS recording by which a robot is measured.

        Args:
            bag: The recording.
            sources: Topics of the measurements.
            losses: Reasons why topics are not recorded completely, by topic.

        Raises:
            RecordingFault: A topic that is named is not there, or has a type that says nothing of it.
        """
        self._bag, self.sources, self._losses = bag, sources, losses or {}
        self._read: list[tuple[Rule[Any], str]] = []
        """Rules that a silent topic would satisfy, each with its topic."""
        self._tree = FrameTree()
        self._ending: list[Rule[Any]] = []
        """Rules that are judged at the end of the run."""
        self._is_tf = bag.has(_TF, TRANSFORMS)
        for message in bag.messages([_TF_STATIC]) if bag.has(_TF_STATIC, TRANSFORMS) else ():
            for transform in message.content.transforms:
                self._tree.place(transform, is_static=True)
        self._unseen: Iterator[Message] = bag.messages([_TF]) if self._is_tf else iter(())
        self._transforms = TransformPoses(self._tree, sources)
        self._poses: dict[int, Pose] = {}
        """Poses that rules measure, by the rule's identity."""
        self._tilted: list[tuple[Rule[Any], Pose]] = []
        self._risen: list[tuple[Rule[Any], Pose]] = []
        self._paired_sources: list[Source] = []
        self._paired: list[PoseTopic] = []
        """Topics with poses that are compared with those of other topics."""
        self._topic_pose = self._find_pose_topic()
        self._contacts = self._find_contacts()
        self._scan = self._find_scan()

    @property
    def topics(self) -> list[str]:
        """Names of the recorded topics that are read to judge the run."""
        _ = self._chosen  # a topic that `/tf` makes needless is not read
        found = [_TF] if self._is_tf else []
        found += [self._topic_pose.source.name] if self._topic_pose else []
        found += self._contacts.topics if self._contacts else []
        return [*found, *([self._scan.topic] if self._scan else [])]

    def is_pose(self, topic: str) -> bool:
        """Returns whether a topic contains poses, which are also read from before the run."""
        return topic == _TF or (self._topic_pose is not None and topic == self._topic_pose.source.name)

    def take(self, message: Message, time_s: float) -> None:
        """Reads poses, lidar scans and contacts from a recorded message; before the run's beginning, only poses.

        Args:
            message: The message.
            time_s: Time in the run, in seconds; negative before its beginning.
        """
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
        """Records an error in rules that need a topic which was silent for too long until a time in seconds."""
        for source in self._steady_sources():
            source.look_back(time_s)
        if self._contacts is not None:
            self._contacts.look_back(time_s)

    def finish(self, end_s: float, *, is_over: bool) -> None:
        """Records which topics were silent at the end, and which violations could have been missed.

        Args:
            end_s: Time of the last check, in seconds.
            is_over: Whether a requirement ended the run before the recording did.
        """
        for source in [*self._steady_sources(), *self._paired_sources]:
            source.finish(end_s)
        planar = [(rule, pose, "are never tilted in the least") for rule, pose in self._tilted if not pose.tilts]
        planar += [(rule, pose, "never change their height") for rule, pose in self._risen if not pose.rises]
        for rule, pose, what in planar:
            if rule.violated_s is None:
                names = ", ".join(source.name for source in pose.sources)
                rule.fail(f"poses of {names} {what}, as those of wheels, so it could be missed")
        if not is_over:
            self._finish_limits(end_s)
        if self._contacts is not None:
            self._contacts.finish(end_s)
        if self._scan is not None:
            self._scan.finish()
        felt = self._contacts.sources if self._contacts else []
        for rule, topic in [*self._read, *((rule, source.name) for source in felt for rule in source.rules)]:
            if topic in self._losses and rule.violated_s is None:
                rule.fail(f"{topic}: {self._losses[topic]}, so something could have been missed")

    def _finish_limits(self, end_s: float) -> None:
        """Makes time limits errors that the recording ends before (`end_s`, in seconds), unless the run was over.

        Goals that are all reached say so, and so does `ends_with_run` in the sources.
        """
        rules = {id(rule): rule for pose in self._poses.values() for source in pose.sources for rule in source.rules}
        goals = [rule.is_reached for rule in rules.values() if rule.is_reached is not None]
        if self.sources.ends_with_run or (goals and all(goals)):
            return
        for rule in self._ending:
            if rule.violated_s is None and end_s <= rule.planned_s:
                rule.fail(
                    f"the recording ends at {end_s:.2f} s, before the limit of {rule.planned_s:g} s, and may be cut "
                    "short; goals that are reached, or ends_with_run: true (in the sources), say that the run was over"
                )

    def note_reader(self, rule: Rule[Any], topic: str) -> None:
        """Registers a rule that reads a topic, as a silent topic would satisfy it without being measured."""
        self._read.append((rule, topic))

    def remarks(self) -> list[str]:
        """Returns notes for readers of the verdict on how the run was measured, such as frames that may drift."""
        found = list(self._contacts.remarks()) if self._contacts else []
        for each in self._paired:
            if each.frame and each.frame != self.sources.map_frame:
                frames = f"the frame {each.frame!r}, which is taken for {self.sources.map_frame!r}"
                found.append(f"poses on {each.source.name} are in {frames}")
        if self.pose is None or not any(source.rules for source in self.pose.sources):
            return found
        frame = self._topic_pose.frame if self._topic_pose else self._root
        if frame and frame != self.sources.map_frame:
            name = self.pose.sources[0].name
            found.append(f"positions are those of {name} in the frame {frame!r}, which may drift from the map")
        return found

    def _steady_sources(self) -> list[Source]:
        """Returns the continuously publishing topics, for which a silence is a gap, each once."""
        poses = [self.pose, *self._bodies.values()]
        found = {id(source): source for pose in poses if pose is not None for source in pose.sources}
        return [*found.values(), *([self._scan.source] if self._scan is not None else [])]

    # Things that rules ask for

    @cached_property
    def _bodies(self) -> dict[str, Pose]:
        """Poses of the frames that requirements name as their `body`."""
        return {}

    def pose_of(self, rule: Rule[Any]) -> Pose:
        """Returns the pose that a requirement's rule is about.

        Raises:
            NotMeasuredError: The recording does not have the pose.
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
            raise NotMeasuredError(self._no_motion(body or self.base))
        if self._poses.get(id(rule)) is not pose:
            self._poses[id(rule)] = pose
            for source in pose.sources:
                source.rules.append(rule)
        return pose

    def pose_pairs(
        self, rule: Rule[Any], estimate: str, truth: str, timed: Callable[[str], Timed]
    ) -> Iterator[PosePair]:
        """Yields the estimated poses of the robot, each with the true one at the same time.

        Args:
            rule: Rule that compares the poses.
            estimate: Topic with the estimates.
            truth: Topic with the true poses.
            timed: Function that reads the messages of a topic, with their times in seconds since the run began.

        Raises:
            NotMeasuredError: The recording does not have one of them.
        """
        gap_s, path = self.sources.max_gap_s, self._bag.path
        pairs = PosePairs(rule, rule.asked, (estimate, truth), gap_s, is_steady=estimate == _TF)
        truths = self._paired_topic(rule, truth, gap_s)
        if estimate != _TF:
            topic = self._paired_topic(rule, estimate, math.inf)
            return pairs.of(poses_on(topic, timed(estimate), path), poses_on(truths, timed(truth), path))
        chain = self._chain(self.sources.map_frame, self.base) if self._is_tf else None
        if chain is None:
            raise NotMeasuredError(self._not_connected())
        transforms = TransformPoses(self._tree.copy(), self.sources)
        links = transforms.pose(chain).sources
        if not links:
            raise NotMeasuredError(self._no_motion(self.base))
        for link in links:
            link.rules.append(rule)
        self._paired_sources += links
        self.note_reader(rule, _TF)
        return pairs.of(poses_in(transforms, chain, timed(_TF), path), poses_on(truths, timed(truth), path))

    def _paired_topic(self, rule: Rule[Any], topic: str, max_gap_s: float) -> PoseTopic:
        """Returns the topic with poses that a rule compares with those of another.

        Raises:
            NotMeasuredError: The recording has no such topic, or its messages have no poses.
        """
        try:
            self._check(topic, POSE_TYPES, "a pose to compare")
        except RecordingFault as fault:
            raise NotMeasuredError(str(fault)) from None
        found = PoseTopic(topic, self.sources.model_copy(update={"max_gap_s": max_gap_s}))
        found.source.rules.append(rule)
        self._paired.append(found)
        self._paired_sources.append(found.source)
        self.note_reader(rule, topic)
        return found

    def expect_tilt(self, rule: Rule[Any]) -> None:
        """Registers a rule that measures the robot's tilt, so that `finish` can check the poses that it measured.

        If no recorded pose was tilted in the least and the rule found no violation, `finish` makes it an error: such
        poses cannot show a tilt.
        """
        self._tilted.append((rule, self.pose_of(rule)))

    def expect_rise(self, rule: Rule[Any]) -> None:
        """Registers a rule that measures the robot's height, so that `finish` can check the poses that it measured.

        If the height of the recorded poses never changed and the rule found no violation, `finish` makes it an error:
        such poses cannot show a height.
        """
        self._risen.append((rule, self.pose_of(rule)))

    def expect_end(self, rule: Rule[Any]) -> None:
        """Registers a rule that is judged at the end of the run, for a check whether the recording has the end."""
        self._ending.append(rule)

    def is_ready(self, rule: Rule[Any]) -> bool:
        """Returns whether a rule can be judged yet: the scan topic and the pose that it reads, if any, are known."""
        pose = self._poses.get(id(rule))
        scanned = self._scan is None or rule not in self._scan.source.rules or self._scan.source.messages > 0
        return scanned and (pose is None or pose.is_known)

    def contacts(self, rule: Rule[Any], world: World | None) -> Callable[[], Mapping[str, float]]:
        """Makes a function that returns the contact forces on the robot, by touched object.

        Raises:
            NotMeasuredError: The recording has no topic with contacts, or it is unknown which side is the robot.
        """
        if self._contacts is None:
            self._refuse_mixed(*self._bag.topics_of(*CONTACT_TYPES))
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
        return self._contacts.reader(rule, listed_names(self._bag, world, self.sources.robot or ""))

    def clearance(self, rule: Rule[Any]) -> Callable[[float], tuple[float, str] | None]:
        """Returns a function that measures the distance to obstacles in metres, from the lidar's scans, for a rule.

        The function returns `None` if nothing is as near as it is asked about.

        Raises:
            NotMeasuredError: The recording has no scan, the robot's radius is unknown, or the rule names objects.
        """
        if self._scan is None:
            self._refuse_mixed(_SCAN)
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
        """Name of the tf frame of the robot's base, such as `base_link`; reads `/tf` ahead until it appears."""
        if self.sources.base_frame is not None:
            return self.sources.base_frame
        for frame in _BASES:
            self._chain(self.sources.map_frame, frame)  # reads until it is there
            if frame in self._tree.parents:
                return frame
        return _BASES[0]

    @cached_property
    def _chosen(self) -> tuple[Pose | None, str]:
        """Returns the robot's pose, and the name of the frame in which it is given (empty: that of the topic).

        The pose is `None` if the recording has no source for it.
        """
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
        """Latest pose of the robot's base as the recording is read, in the frame `_root`; `None`: it has none."""
        return self._chosen[0]

    @property
    def _root(self) -> str:
        return self._chosen[1]

    def _chain(self, root: str, frame: str) -> list[str] | None:
        """Returns the chain of frames from a root to a frame; reads `/tf` ahead until it is complete.

        Returns `None` if the whole recording does not connect them.
        """
        while (found := self._tree.chain(root, frame)) is None:
            message = next(self._unseen, None)
            if message is None:
                return None
            for transform in message.content.transforms:
                self._tree.know(transform, is_static=False)
        return found

    def _no_motion(self, frame: str) -> str:
        return f"{self._bag.path.name}: all frames from the map to {frame!r} are on {_TF_STATIC}, so it could not move"

    def _not_connected(self, *others: str) -> str:
        """Returns the error text that `/tf` does not connect the robot to the map or to another frame.

        Raises an error if `/tf` has messages of several types.
        """
        self._refuse_mixed(_TF)
        frames = ", ".join(sorted({*self._tree.parents, *self._tree.parents.values()})[:_MAX_SHOWN]) or "none"
        roots = " or ".join(map(repr, (self.sources.map_frame, *others)))
        where = f"{self._bag.path.name} does not say where the robot is"
        return f"{where}: {_TF} does not lead from {roots} to {self.base!r} (it has {frames})"

    def _no_pose(self) -> str:
        sources = self.sources
        self._refuse_mixed(_TF, _ODOM)
        where = f"{self._bag.path.name} does not say where the robot is"
        if sources.pose == _TF or self._is_tf:
            return f"{self._not_connected(_ODOM_FRAME)}, and there is no topic {_ODOM}"
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
        return PoseTopic(_ODOM, self.sources) if self._bag.has(_ODOM, POSE_TYPES) else None

    def _find_contacts(self) -> Contacts | None:
        for topic in self.sources.contacts:
            self._check(topic, tuple(CONTACT_TYPES), "contacts")
        own = [_CONTACTS] if MARKERS in self._bag.types.get(_CONTACTS, ()) else []
        usual = [*self._bag.topics_of(*(each for each in CONTACT_TYPES if each != MARKERS)), *own]
        topics = self.sources.contacts or list(dict.fromkeys(usual))
        # Where one of them cannot be read, something could have been missed on it.
        is_readable = all(self._bag.has(topic, tuple(CONTACT_TYPES)) for topic in topics)
        return Contacts(topics, self._bag.types, self.sources) if topics and is_readable else None

    def _find_scan(self) -> Scan | None:
        wanted = self.sources.scan
        if wanted is not None:
            self._check(wanted, (SCAN_TYPE,), "scan")
        else:
            there = self._bag.topics_of(SCAN_TYPE)
            wanted = _SCAN if _SCAN in there else there[0] if len(there) == 1 else None
            wanted = wanted if wanted is not None and self._bag.has(wanted, (SCAN_TYPE,)) else None
        return Scan(wanted, self._tree, self.base, self.sources) if wanted else None

    def _refuse_mixed(self, *topics: str) -> None:
        """Raises an error if a topic has messages of several types, which is why it is not read.

        Raises:
            NotMeasuredError: A topic has messages of several types.
        """
        for topic in topics:
            if (why := self._bag.mixed(topic)) is not None:
                raise NotMeasuredError(f"{self._bag.path.name}: {why}")

    def _check(self, topic: str, types: Sequence[str], member: str) -> None:
        """Raises an error if a topic of the sources does not exist or has an unsuitable type.

        Raises:
            RecordingFault: The topic is not in the recording, or has another type.
        """
        found = self._bag.type_of(topic)
        if found not in types:
            raise RecordingFault(
                f"{self._bag.path}: {member} is {topic}, whose type is {found}; {', '.join(types)} would be right"
            )


class TopicScene:
    """Scene for judging requirements by a ROS recording instead of a physics simulation; see `Scene`.

    Measurements that a recording does not have raise `NotMeasuredError`.
    """

    def __init__(
        self,
        environment: Any,
        measurements: Measurements,
        plan: RunPlan,
        read_world: Callable[[], World | None],
        *,
        calls_functions: bool,
    ) -> None:
        """Creates the scene in which requirements are measured on a ROS recording.

        Args:
            environment: Environment that replays the recording.
            measurements: Measurements of the recording.
            plan: Plan of the run.
            read_world: Function that reads the world, if there is one.
            calls_functions: Whether functions of applications may be called, which is user code.
        """
        self.environment = environment
        self._measurements, self._plan, self._read_world = measurements, plan, read_world
        self._calls_functions = calls_functions

    @property
    def world(self) -> World | None:
        """World that the robot was in; `None` if it is not known."""
        return self._read_world()

    def position(self, rule: Rule[Any]) -> Sequence[float]:
        """Returns the robot's position x, y, z in metres, as a sequence that follows the recording."""
        return self._measurements.pose_of(rule).position

    def orientation(self, rule: Rule[Any]) -> Sequence[float]:
        """Returns the robot's orientation (quaternion, w first), as a sequence that follows the recording."""
        return self._measurements.pose_of(rule).orientation

    def can_tilt(self, rule: Rule[Any]) -> bool:
        """Returns true, and registers the rule: if all recorded poses are level, it is an error at the end."""
        self._measurements.expect_tilt(rule)
        return True

    def can_rise(self, rule: Rule[Any]) -> bool:
        """Returns true, and registers the rule: if all recorded poses have one height, it is an error at the end."""
        self._measurements.expect_rise(rule)
        return True

    def expect_end(self, rule: Rule[Any]) -> None:
        """Registers a rule that is judged at the end of the run, which the recording may not contain."""
        self._measurements.expect_end(rule)

    def is_ready(self, rule: Rule[Any]) -> bool:
        """Returns whether every topic that the rule needs has had a message."""
        return self._measurements.is_ready(rule)

    def floor(self, rule: Rule[Any]) -> MapFloor | None:
        """Returns the free floor of the world, from its map; `None`: there is no world."""
        return floor_of(self._plan, rule)

    def messages(self, rule: Rule[Any], topic: str) -> Iterator[tuple[float, Any]]:
        """Yields the messages on a topic, each with its time in seconds.

        Raises:
            NotMeasuredError: The recording has no such topic.
        """
        if all(getattr(rule.asked, each, None) is None for each in _ASKS_FOR_MESSAGES):
            self._measurements.note_reader(rule, topic)
        return self.environment.messages_on(topic)

    def pose_pairs(self, rule: Rule[Any], estimate: str, truth: str) -> Iterator[PosePair]:
        """Yields the estimated poses on a topic, each with the true one on another topic at the same time.

        Raises:
            NotMeasuredError: The recording has no such topic.
        """
        return self._measurements.pose_pairs(rule, estimate, truth, self.environment.timed)

    def contacts(self, rule: Rule[Any]) -> Callable[[], Mapping[str, float]]:
        """Returns a function that returns the contact forces (N) recorded since its last call, by touched object."""
        return self._measurements.contacts(rule, self.world)

    def clearance(self, rule: Rule[Any]) -> Callable[[float], tuple[float, str] | None]:
        """Returns a function that returns the smallest recorded distance to obstacles in metres since its last call."""
        return self._measurements.clearance(rule)

    def function(self, rule: Rule[Any], attribute: str) -> Callable[..., Any]:
        """Imports and returns a predicate function of an installed package or of the job's applications.

        Raises:
            NotMeasuredError: Functions are not called here.
            RequirementError: The function does not exist.
        """
        if not self._calls_functions:
            raise NotMeasuredError(
                f"{attribute} is a function, which is not called for a job of programs; `robomaker judge` calls it"
            )
        return load_judging_function(self._plan, rule, attribute)

    def __getattr__(self, name: str) -> Any:
        """Returns, for a measurement that recordings do not have, a function that raises `NotMeasuredError`.

        Raises `AttributeError` for private names.
        """
        if name.startswith("_"):
            raise AttributeError(name)

        def missing(*_arguments: object, **_options: object) -> Any:
            raise NotMeasuredError(f"{name} is measured in simulations only, and not in a recording")

        return missing
