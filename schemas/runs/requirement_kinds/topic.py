"""Requirement on messages of a ROS topic: rate, range of a field, or absence of errors."""

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from ...wire.base import ShapeName, optional
from ...wire.common import text
from ...wire.json_values import is_list
from .kind import Count, Look, NamePatterns, Numbers, RequirementKind, RosTopic, Rule, Scene, Seconds, is_meant

Frequency = Annotated[float, ShapeName("Frequency"), Field(gt=0, le=1e5, allow_inf_nan=False)]
FieldPath = Annotated[str, ShapeName("FieldPath"), text(1, 255, r"[a-zA-Z_][a-zA-Z0-9_]*(\.[a-zA-Z_][a-zA-Z0-9_]*)*")]
Bound = Annotated[float, ShapeName("Bound"), Field(allow_inf_nan=False)]

_ERROR, _ERROR_OF_ROS1 = 40, 8
"""Log levels of `/rosout` from which a line is an error, in ROS 2 and ROS 1."""
_QUESTIONS = ("min_hz", "max_gap_s", "field", "nodes")
_SHOWN = 12
"""Maximum number of message fields that an error names."""


class TopicRequirement(RequirementKind):
    """Pass criterion: messages on a ROS topic come often enough, within a range, or without errors."""

    violated_when = (
        "messages on `topic` come less often than `min_hz`, or with a longer gap than `max_gap_s`; or `field` is below "
        "`min` or above `max`; or `nodes` write lines at ERROR to `/rosout`, more than `max_errors` (0)"
    )
    more_members = "one of `min_hz`, `max_gap_s`, `field`, `nodes`"
    margins_compare = False  # the unit is that of the one that is asked for

    kind: Literal["topic"] = Field(description="`topic`.")
    topic: RosTopic = Field(description="Topic that is recorded, `/scan`.")
    min_hz: Frequency | None = optional("Least messages a second, on average over the run.")
    max_gap_s: Seconds | None = optional("Longest time without a message, also at the beginning and the end.")
    field: FieldPath | None = optional(
        "Field of the messages whose numbers have a range, `pose.pose.position.x`; of a list, all finite numbers in it."
    )
    min: Bound | None = optional("Least value of the field.")
    max: Bound | None = optional("Greatest value of the field.")
    nodes: NamePatterns | None = optional("Names of nodes, with `*` for any text, whose lines on `/rosout` are judged.")
    max_errors: Count = Field(default=0, description="How many lines at ERROR or FATAL the nodes may write.")

    @property
    def by_topics(self) -> bool:
        """True: the requirement is measured by recorded topics only."""
        return True

    @model_validator(mode="after")
    def _one_question(self) -> Self:
        asked = [each for each in _QUESTIONS if getattr(self, each) is not None]
        if len(asked) != 1:
            there = f"both {' and '.join(asked[:2])}" if asked else f"none of {', '.join(_QUESTIONS)}"
            raise ValueError(f"{there}; a requirement asks for one of them")
        has_range = self.min is not None or self.max is not None
        if (self.field is not None) != has_range:
            raise ValueError("field needs min or max, or both" if self.field else "min and max need a field")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"min: {self.min:g} is above max, {self.max:g}; swap them")
        if self.stop:
            raise ValueError("stop: topics are judged when the run is over; leave out stop")
        return self


class TopicRule(Rule[TopicRequirement]):
    """Judges the recorded messages of a topic, in recorded order."""

    def __init__(self, asked: TopicRequirement) -> None:
        super().__init__(asked)
        self.count = 0
        self.longest_s = 0.0
        """Longest time without a message so far, in seconds."""
        self.least = math.inf
        self.greatest = -math.inf
        self.errors = 0
        self._last_s = 0.0
        self._spoke: set[str] = set()
        self._first_error = ""

    def bind(self, scene: Scene) -> Look:
        """Connects the rule to the recorded messages of the topic.

        Raises:
            NotMeasuredError: The run has no recording, or the recording has no such topic.
        """
        messages = iter(scene.messages(self, self.asked.topic))
        ahead = next(messages, None)

        def look(time_s: float) -> None:
            nonlocal ahead
            while ahead is not None and ahead[0] <= time_s and self.error is None:
                self.update(*ahead)
                ahead = next(messages, None)

        return look

    def update(self, time_s: float, message: Any) -> None:
        """Judges the gap before a message, and the message's field or diagnostic status."""
        asked = self.asked
        self.count += 1
        self.note_silence(time_s)
        if asked.field is not None:
            self._take_field(time_s, message, asked.field)
        elif asked.nodes is not None:
            self._take_line(time_s, message, asked.nodes)

    def note_silence(self, time_s: float) -> None:
        """Judges the silence since the last message; longer than `max_gap_s` is a violation."""
        gap_s, self._last_s = time_s - self._last_s, time_s
        self.longest_s = max(self.longest_s, gap_s)
        if self.asked.max_gap_s is not None and gap_s > self.asked.max_gap_s:
            self.violate(time_s)

    def _take_field(self, time_s: float, message: Any, path: str) -> None:
        value = message
        for name in path.split("."):
            if not hasattr(value, name):
                fields = [each for each in getattr(value, "__dataclass_fields__", {}) if not each.startswith("__")]
                self.fail(
                    f"a message on {self.asked.topic} has no field {path}; there are {', '.join(fields[:_SHOWN])}"
                )
                return
            value = getattr(value, name)
        try:
            numbers = list(_numbers_in(value))
        except (TypeError, ValueError):
            self.fail(f"{path} on {self.asked.topic} is {str(value)[:80]} at {time_s:.2f} s, which is no number")
            return
        for number in numbers:
            self.least, self.greatest = min(self.least, number), max(self.greatest, number)
            if number < (-math.inf if self.asked.min is None else self.asked.min):
                self.violate(time_s)
            if number > (math.inf if self.asked.max is None else self.asked.max):
                self.violate(time_s)

    def _take_line(self, time_s: float, message: Any, nodes: list[str]) -> None:
        if not all(hasattr(message, name) for name in ("level", "name", "msg")):
            self.fail(f"messages on {self.asked.topic} are no lines of a log; /rosout would be right")
            return
        name = str(message.name).removeprefix("/")
        if not is_meant(name, [each.removeprefix("/") for each in nodes], None):
            return
        self._spoke.add(name)
        if message.level >= (_ERROR_OF_ROS1 if hasattr(message, "header") else _ERROR):
            self.errors += 1
            self._first_error = self._first_error or f"{name}: {str(message.msg)[:200]}"
            if self.errors > self.asked.max_errors:
                self.violate(time_s)

    def _unjudgeable(self) -> str | None:
        asked = self.asked
        if self.error is not None:
            return None
        if asked.field is not None and self.least > self.greatest:
            return f"there was no number in {asked.field} on {asked.topic}"
        if asked.nodes is not None:
            silent = [
                each
                for each in asked.nodes
                if not any(is_meant(name, [each.removeprefix("/")], None) for name in self._spoke)
            ]
            if silent:
                return f"no line of {silent[0]} came on {asked.topic}, so its errors would not have come either"
        if asked.max_gap_s is not None and not self.count and self._end_s <= asked.max_gap_s:
            return f"no message came on {asked.topic}, and the run was over before that was a gap"
        if asked.min_hz is not None:
            if self._end_s <= 0:
                return "the run took no time"
            if self.rate_hz < asked.min_hz:
                self.violate(self._end_s)
        self.note_silence(self._end_s)
        return None

    @property
    def rate_hz(self) -> float:
        """Mean rate of messages over the run, in Hz."""
        return self.count / self._end_s if self._end_s > 0 else 0.0

    def _numbers(self) -> Numbers:
        asked = self.asked
        if asked.min_hz is not None:
            return Numbers(self.rate_hz, asked.min_hz, "Hz", at_least=True)
        if asked.max_gap_s is not None:
            return Numbers(self.longest_s, asked.max_gap_s, "s")
        if asked.nodes is not None:
            return Numbers(float(self.errors), float(asked.max_errors), "errors")
        if asked.max is None or (asked.min is not None and self.least - asked.min < asked.max - self.greatest):
            return Numbers(self.least, asked.min, None, at_least=True)
        return Numbers(self.greatest, asked.max, None)

    def _detail(self) -> str:
        asked, numbers = self.asked, self._numbers()
        if asked.min_hz is not None:
            return f"{self.count} messages on {asked.topic}, {self.rate_hz:.2f} Hz, {asked.min_hz:g} Hz asked for"
        if asked.max_gap_s is not None:
            gap = f"at most {self.longest_s:.2f} s without a message on {asked.topic}"
            return f"{gap}, {asked.max_gap_s:g} s allowed{self._until()}"
        if asked.nodes is not None:
            first = f": {self._first_error}" if self._first_error else ""
            return f"{self.errors} lines at ERROR on {asked.topic}, {asked.max_errors} allowed{self._until()}{first}"
        bound = "at least" if numbers.at_least else "at most"
        values = f"{asked.field} on {asked.topic} from {self.least:g} to {self.greatest:g}"
        return f"{values}, {bound} {numbers.limit:g} asked for{self._until()}"


def _numbers_in(value: Any) -> Iterator[float]:
    """Yields the numbers of a field; of a list, the finite ones.

    Raises:
        TypeError: The value is not a number.
        ValueError: The value cannot be converted to a number, or is not finite.
    """
    values: Any = value.tolist() if hasattr(value, "tolist") else value
    if is_list(values):
        yield from (number for each in values if math.isfinite(number := float(str(each))))
        return
    if isinstance(values, str) or not math.isfinite(number := float(values)):
        raise ValueError
    yield number
