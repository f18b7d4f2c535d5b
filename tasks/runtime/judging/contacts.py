"""Contacts in a ROS recording: touched objects, forces, and the object names that rules use."""

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence, Set
from fnmatch import fnmatchcase
from typing import Any

from ....schemas.runs.recording_sources import RecordingSources
from ....schemas.runs.requirement_kinds.kind import NotMeasuredError, Rule, is_meant
from ....schemas.wire.request_problems import first_words, nearest
from ....schemas.worlds.world import World
from .bags import Bag, Message
from .silences import Source


class Contacts:
    """Contact forces from recorded topics: the largest force of each object since the last check."""

    def __init__(self, topics: Sequence[str], types: Mapping[str, Set[str]], sources: RecordingSources) -> None:
        """Prepares to read contacts from topics of a ROS recording.

        Args:
            topics: Topics with contacts.
            types: ROS types of each topic's messages.
            sources: Settings about the recording's topics, such as which side of a contact is the robot.
        """
        self.topics = list(topics)
        self.robot = sources.robot
        self._speak_on_touch = sources.contacts_on_touch
        self.sources = [Source(topic, self._longest_silence_s(types[topic], sources)) for topic in topics]
        self._is_own = {topic: MARKERS in types[topic] for topic in topics}
        """Whether each topic was written by this package's recorder, which writes nothing without a contact."""
        self._by_topic = dict(zip(self.topics, self.sources, strict=True))
        self._is_robot_seen = False
        self._others: set[str] = set()
        self._readers: list[dict[str, float]] = []
        self._names = Names()

    @staticmethod
    def _longest_silence_s(types: Set[str], sources: RecordingSources) -> float:
        """Returns the longest acceptable silence of a contact topic: Gazebo classic publishes without contacts, too."""
        return sources.max_gap_s if _STATES in types and not sources.contacts_on_touch else math.inf

    def look_back(self, time_s: float) -> None:
        """Records an error in rules on a continuous topic of contacts that was silent for too long until a time."""
        for source in self.sources:
            if source.messages:  # the end says of a topic that never spoke why that may be
                source.look_back(time_s)

    def reader(self, rule: Rule[Any], listed: Collection[str]) -> Callable[[], Mapping[str, float]]:
        """Makes a function that returns the contact forces since its last call, by object.

        Args:
            rule: Rule that reads the contacts.
            listed: Names of the objects that can be touched, if they are known.

        Raises:
            NotMeasuredError: All that there could be is ignored.
        """
        self._names.expect(rule, listed)
        felt: dict[str, float] = {}
        self._readers.append(felt)
        for source in self.sources:
            source.rules.append(rule)

        def read() -> Mapping[str, float]:
            now = dict(felt)
            felt.clear()
            return now

        return read

    def take(self, message: Message, time_s: float) -> None:
        """Reads the robot's contacts from a recorded message; keeps each touched object's largest force in newtons.

        A contact without a finite force makes the rules that use the topic errors.
        """
        source = self._by_topic[message.topic]
        source.hear(time_s)
        for name, force in CONTACT_TYPES[message.type](message.content, self._other_side):
            self._names.heard.add(name)
            if not math.isfinite(force):
                for rule in source.rules:
                    rule.fail(f"{source.name} says that {name} was touched, and not how hard")
                continue
            for felt in self._readers:
                felt[name] = max(felt.get(name, 0.0), force)

    def _other_side(self, first: str, second: str) -> str | None:
        """Returns the name of the object that the robot touches in a contact of two named sides.

        Returns `None` if the robot is not involved, touches itself, or touches the floor. Names of other models are
        noted, for errors.
        """
        ours = [_is_of(name, self.robot or "") for name in (first, second)]
        self._is_robot_seen = self._is_robot_seen or any(ours)
        if ours[0] == ours[1]:
            there = [name for name in (first, second) if not any(ours)]
            self._others.update(map(_model_of, there))
            self._names.heard.update(name for name in there if not _is_of(name, _FLOOR))
            return None
        other = second if ours[0] else first
        return None if _is_of(other, _FLOOR) else other

    def finish(self, end_s: float) -> None:
        """Records an error in rules, at the recording's end, if the robot's contacts could not be recognised in it.

        Args:
            end_s: Time of the end in the run, in seconds.
        """
        for source in self.sources:
            if not (source.messages or self._speak_on_touch or self._is_own[source.name]):
                for rule in source.rules:
                    rule.fail(
                        f"no message came on {source.name}: nothing was touched, or its sensor was off, which nothing "
                        "tells apart; contacts_on_touch: true (in the sources) says that it speaks on touch only"
                    )
            source.finish(end_s)
            for rule in source.rules if self._others and not self._is_robot_seen else ():
                models = ", ".join(sorted(self._others)[:_MAX_SHOWN])
                rule.fail(f"no contact on {source.name} is of a model named {self.robot!r} (robot); there are {models}")
        self._names.finish()

    def remarks(self) -> Iterator[str]:
        """Yields notes about contact topics that had no messages."""
        for source in self.sources:
            if source.rules and not source.messages:
                yield f"no message came on {source.name}, which is taken for nothing was touched"
        yield from self._names.remarks()


class Names:
    """Names of touched objects by which requirements distinguish contacts; finds misspelt names."""

    def __init__(self) -> None:
        self.heard: set[str] = set()
        """Names of the objects in contacts, without the floor."""
        self._listed: Collection[str] = ()
        self._rules: list[Rule[Any]] = []

    def expect(self, rule: Rule[Any], listed: Collection[str]) -> None:
        """Registers a rule that may distinguish touched objects by name.

        Raises:
            NotMeasuredError: The rule ignores everything that the recording could have contacts with.
        """
        self._listed = listed
        others, ignore = rule.asked.others, rule.asked.ignore
        if everything := [each for each in ignore or () if not each.strip("*")]:
            raise NotMeasuredError(f"ignore is {everything[0]!r}, which is everything, so nothing could be missed")
        if listed and not any(is_meant(name, others, ignore) for name in listed) and others is None:
            raise NotMeasuredError("ignore has the names of all things that are known, so nothing could be missed")
        if others or ignore:
            self._rules.append(rule)

    def finish(self) -> None:
        """Records an error in rules that name objects which the recording lacks: they could not be violated.

        A rule that was violated stays as it is.
        """
        for rule in self._rules:
            unknown = [each for each in rule.asked.others or () if not self._is_known(each)]
            if unknown and rule.violated_s is None:  # what was found stands
                rule.fail(
                    f"nothing in the recording is named like {unknown[0]!r} (others){self._near(unknown[0])}; a world "
                    f"(--world), or a recording of {MODEL_STATES}, says what there is that was not touched"
                )
            misspelt = next(self._misspelt(rule), None)
            if misspelt is not None and self._listed:
                rule.fail(f"nothing is named like {misspelt!r} (ignore){self._near(misspelt)}")

    def remarks(self) -> Iterator[str]:
        """Yields remarks about ignored names that fit no object, but are similar to an object's name."""
        for rule in self._rules:
            if rule.error is None and (misspelt := next(self._misspelt(rule), None)) is not None:
                touched = f"{rule.asked.name}: nothing that was touched is named like {misspelt!r} (ignore)"
                yield f"{touched}{self._near(misspelt)}"

    def _misspelt(self, rule: Rule[Any]) -> Iterator[str]:
        """Yields ignored names that match no object but resemble one; names of absent objects are allowed."""
        for each in rule.asked.ignore or ():
            if not self._is_known(each) and "did you mean" in self._near(each):
                yield each

    def _is_known(self, pattern: str) -> bool:
        if any(fnmatchcase(name, pattern) for name in (*self.heard, *self._listed)):
            return True
        model = _model_of(pattern)  # `wall::*` is a part of the model `wall`, which a list has without its parts
        return bool(model.strip("*")) and any(fnmatchcase(name, model) for name in self._listed)

    def _near(self, pattern: str) -> str:
        there = sorted({*self.heard, *self._listed})
        models = [_model_of(name) for name in there]
        return nearest(_model_of(pattern).strip("*"), models) or f"; there are {first_words(there) or 'no names in it'}"


MODEL_STATES = "/gazebo/model_states"
"""Topic on which Gazebo classic publishes the names of its models."""
_MODELS: Mapping[str, Callable[[Any], list[str]]] = {
    "gazebo_msgs/msg/ModelStates": lambda m: list(m.name),
    "tf2_msgs/msg/TFMessage": lambda m: [each.child_frame_id for each in m.transforms],
}
"""Functions that read model names from messages, by ROS type; Gazebo's `pose/info` is bridged as transforms."""
_FRAMES = ("tf", "tf_static")
"""Last parts of the names of tf topics, which may have a prefix, such as `/robot1/tf`."""


def listed_names(bag: Bag, world: World | None, robot: str) -> frozenset[str]:
    """Returns the names of the objects that may be touched, if a world or a list of models has them.

    The robot and the floor are left out.

    Args:
        bag: Recording to read the model names from.
        world: World of the run, if it is known.
        robot: Gazebo's name of the robot's model.
    """
    found: set[str] = set()
    for topic in bag.topics_of(*_MODELS):
        if topic.rpartition("/")[2] not in _FRAMES and bag.mixed(topic) is None:
            first = next(iter(bag.messages([topic])), None)
            found.update(_MODELS[first.type](first.content) if first is not None else ())
    found = {name for name in found if not (fnmatchcase(name, robot) or name == _FLOOR)}
    if world is not None:
        found |= {
            "wall",
            *(each.id for each in world.furniture),
            *(each.door.id for each in world.floorplan.passages if each.door is not None),
        }
    return frozenset(found)


def _model_of(name: str) -> str:
    """Returns the model of a Gazebo collision name: `wall` for `wall::link::collision`; other names unchanged."""
    return name.partition("::")[0]


_FLOOR = "ground_plane"
"""Name of Gazebo's default floor model, which may always be touched."""
_MAX_SHOWN = 12
_OtherSide = Callable[[str, str], str | None]


def _is_of(name: str, model: str) -> bool:
    """Returns whether a collision name (`model::link::collision`) belongs to a model, possibly a nested one."""
    return any(fnmatchcase(part, model) for part in name.split("::")[:-1])


def fits_floor(model: str) -> bool:
    """Returns whether a model name pattern with `*` also matches the floor, as `*` alone does."""
    return fnmatchcase(_FLOOR, model)


def _of_markers(content: Any, other_side: _OtherSide) -> Iterator[tuple[str, float]]:
    """Reads contacts of this package's recordings: each object's name and its force in newtons.

    The force is NaN if the text of a marker does not begin with a number.
    """
    del other_side  # they are all of the robot
    sums: dict[str, float] = {}
    for marker in content.markers:
        found = re.match(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", marker.text)
        sums[marker.ns] = sums.get(marker.ns, 0.0) + (float(found[0]) if found else math.nan)
    yield from sums.items()


def _of_states(content: Any, other_side: _OtherSide) -> Iterator[tuple[str, float]]:
    """Reads contacts of Gazebo classic: each object's name and its force in newtons."""
    for state in content.states:
        name = other_side(state.collision1_name, state.collision2_name)
        if name is not None:
            forces = [_along(wrench.force, state.contact_normals, i) for i, wrench in enumerate(state.wrenches)]
            yield name, sum(forces) if forces else math.nan


def _of_contacts(content: Any, other_side: _OtherSide) -> Iterator[tuple[str, float]]:
    """Reads contacts of Gazebo, as its ROS bridge publishes them: each object's name and its force in newtons."""
    for contact in content.contacts:
        name = other_side(contact.collision1.name, contact.collision2.name)
        if name is not None:
            forces = [_along(w.body_1_wrench.force, contact.normals, i) for i, w in enumerate(contact.wrenches)]
            yield name, sum(forces) if forces else math.nan


def _along(force: Any, normals: Sequence[Any], index: int) -> float:
    """Returns the component of a force along its contact's normal in newtons; the whole force without a normal."""
    size = math.hypot(force.x, force.y, force.z)
    if index >= len(normals):
        return size
    normal = normals[index]
    length = math.hypot(normal.x, normal.y, normal.z)
    return abs(force.x * normal.x + force.y * normal.y + force.z * normal.z) / length if length > 0 else size


_STATES = "gazebo_msgs/msg/ContactsState"
CONTACT_TYPES: Mapping[str, Callable[[Any, _OtherSide], Iterator[tuple[str, float]]]] = {
    _STATES: _of_states,
    "ros_gz_interfaces/msg/Contacts": _of_contacts,
    "visualization_msgs/msg/MarkerArray": _of_markers,
}
"""Functions that read contacts, by ROS type: name of the touched object, and force in newtons (NaN: not in the
message).
"""
MARKERS = "visualization_msgs/msg/MarkerArray"
"""ROS type of contacts in this package's recordings; other software uses the same type for other drawings."""
