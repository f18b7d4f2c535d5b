"""Observer that checks a run against its requirements."""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.programs import RunStop
from ....schemas.runs.requirement_kinds.kind import Look, NotMeasuredError, Requirement, RequirementError, Rule
from ....schemas.runs.requirement_kinds.off import OffRule
from ....schemas.runs.requirements import JobRequirement, parse_requirements
from ....schemas.wire.errors import InvalidParameterException
from ....schemas.worlds.world import World
from ..episode.physics import raw_physics
from ..episode.progress import RunEnded
from ..episode.run_results import Findings, Observer
from .scene import Scene

_NO_PHYSICS = "the environment has no `physics` to judge it by"
_NEVER_BEGAN = "the run ended before there was an environment"
_ROUNDING_S = 5e-7


class RequirementsObserver(Observer):
    """Observer that checks the requirements (pass criteria) of a run, each at its own interval.

    Without requirements it costs one call. A requirement that cannot be judged fails the run at its first step, before
    time is wasted.
    """

    def __init__(self, plan: RunPlan, world: World | None = None) -> None:
        """Prepares to check a run's requirements, which begins with its first step.

        Args:
            plan: Plan of the run; its requirements replace those of the environment with the same names.
            world: World of the run; absent: it is read when needed.
        """
        self._plan = plan
        self._rules: list[Rule[Any]] | None = None
        self._checks: list[_Check] = []
        self._within_steps: list[_Check] = []
        self._model: Any = None
        self._world = cache(lambda: _world_of(plan) if world is None else world)
        self._data: Any = None
        self._refresh: Callable[[], None] = _show_nothing
        """Function that shows the rules the present poses."""
        self._time_s = 0.0
        self.judged: list[Requirement] = []
        """The judged requirements, once the observer is closed."""

    @property
    def rules(self) -> list[Rule[Any]]:
        """Rules that judge the run, in the order of the requirements; empty before its first step."""
        return self._rules or []

    @property
    def time_s(self) -> float:
        """Simulated time of the last check, in seconds."""
        return self._time_s

    def watch(self, environment: Any, time_s: float) -> None:
        """Judges the requirements that are due at the simulated time, and sets `next_time_s`, when the next one is due.

        The first call prepares the checks; without requirements, none is ever due.

        Raises:
            RunEnded: A requirement that stops the run is violated, or all goals that do are reached.
            RequirementError: A requirement cannot be judged.
        """
        self._time_s = time_s
        if self._rules is None:
            self._begin(environment)
        if not self._rules:
            self.next_time_s = math.inf
            return
        if raw_physics(environment.physics)[0] is not self._model:
            self._bind(environment)
        self._refresh()
        for check in self._checks:
            check.look_if_due(time_s)
        if any(rule.is_over for rule in self._rules) or self._all_goals_reached(self._rules):
            raise RunEnded
        self.next_time_s = min(check.next_time_s for check in self._checks)

    def state(self) -> dict[str, Any]:
        """Returns the state of all requirements for a checkpoint."""
        return {
            "rules": self._rules,
            "due_s": [check.next_time_s for check in self._checks],
            "next_time_s": self.next_time_s,
            "time_s": self._time_s,
        }

    def restore(self, state: dict[str, Any], environment: Any) -> None:
        """Restores the state of all requirements from a checkpoint.

        Raises:
            RequirementError: A requirement cannot be judged.
        """
        self._rules, self._time_s = state["rules"], state["time_s"]
        if self._rules:
            self._bind(environment)
            for check, due_s in zip(self._checks, state["due_s"], strict=True):
                check.next_time_s = due_s
        self.next_time_s = state["next_time_s"]

    def close(self, ended_by: str | None) -> Findings:
        """Returns the judged requirements; empty for a run that failed.

        Args:
            ended_by: Cause of the run's end; None if it failed.
        """
        if ended_by is None:
            return Findings()
        rules = self._rules
        if rules is None:  # the environment was never made
            rules = make_rules(self._plan.requirements)
            for rule in rules:
                rule.fail(_NEVER_BEGAN)
        for check in self._checks:
            check.note_room()
        judged = self.judged = [rule.judged(self._time_s, ended_by) for rule in rules]
        notes = [note for rule in rules if (note := rule.remark()) is not None]
        if ended_by == RunStop.DURATION_LIMIT and (cut := self._cut_in_words(rules)):
            notes.append(cut)
        return Findings(metrics=_metrics(rules), requirements=judged, notes=notes)

    def last_look(self, environment: Any) -> None:
        """Checks all requirements once more at the end of the run.

        Raises:
            RequirementError: The environment's requirements are invalid.
        """
        if self._rules is None:
            self._begin(environment)
        if self._data is None:
            for rule in self._rules or ():
                rule.fail(_NO_PHYSICS)
            return
        self._time_s = max(self._time_s, self._data.time)
        self._refresh()
        for check in self._checks:
            check.look_if_new(self._time_s)

    def _cut_in_words(self, rules: Sequence[Rule[Any]]) -> str:
        """Describes how much of the run the job's duration limit has cut off; empty if that is unknown.

        An example: `the job's duration limit ended the run at 12.00 of 60 s: 80 % were not driven`.
        """
        whole_s = max((rule.planned_s for rule in rules), default=0.0)
        cut = f"the job's duration limit ended the run at {self._time_s:.2f}"
        if self._time_s >= whole_s:
            return f"{cut} s" if rules else ""
        return f"{cut} of {whole_s:g} s: {100 * (1 - self._time_s / whole_s):.0f} % were not driven"

    def _begin(self, environment: Any) -> None:
        own = _own_requirements(environment)
        self._rules = make_rules(merged(self._plan.requirements, own))
        names = {requirement.name for requirement in own}
        for rule in self._rules:
            if isinstance(rule, OffRule):
                rule.is_there = rule.asked.name in names

    def _bind(self, environment: Any) -> None:
        """Binds the rules to the environment's model, which environments may replace.

        If rules look within control steps, the environment is asked to call them there.
        """
        self._model, self._data = raw_physics(environment.physics)
        make_scene = getattr(environment, "requirements_scene", None)  # of one that plays a recording
        if make_scene is None:
            scene = Scene(environment, self._model, self._data, self._plan, self._world)
        else:
            scene = make_scene(self._plan, self._world)
        # Recordings have no state to ask, and show the present poses by themselves.
        room_of, self._refresh = (scene.room_of, scene.refresh) if isinstance(scene, Scene) else (None, _show_nothing)
        self._checks = [_Check(rule, _bound(rule, scene), room_of) for rule in self._rules or ()]
        self._within_steps = [check for check in self._checks if check.rule.looks_within_steps]
        physics = environment.physics
        if self._within_steps and hasattr(physics, "between_substeps"):
            # Touches are short: an environment that lets others look within its control steps is asked to.
            physics.between_substeps = _both(physics.between_substeps, self._look_within(self._data))

    def _look_within(self, data: Any) -> Callable[[], None]:
        def look() -> None:
            time_s = data.time
            for check in self._within_steps:
                check.look_if_due(time_s)

        return look

    @staticmethod
    def _all_goals_reached(rules: Sequence[Rule[Any]]) -> bool:
        goals = [rule for rule in rules if rule.is_reached is not None and rule.asked.stop]
        return bool(goals) and all(goal.is_reached for goal in goals)


def _bound(rule: Rule[Any], scene: Any) -> Look:
    """Binds a rule to a scene, and returns the function that checks it at a time in seconds.

    A rule that cannot be measured there becomes an error, and its function does nothing.
    """
    try:
        look = rule.bind(scene)
    except NotMeasuredError as error:
        rule.fail(str(error))
        return lambda _time_s: None
    is_ready = getattr(scene, "is_ready", None)  # of a recording, which begins before all of its topics
    if is_ready is None:
        return look
    return lambda time_s: look(time_s) if is_ready(rule) else None


class _Check:
    """A rule of a requirement, bound to its measurement, with the time in seconds at which it is looked at next."""

    def __init__(self, rule: Rule[Any], look: Look, room_of: Callable[[Rule[Any]], str | None] | None) -> None:
        self.rule = rule
        self._room_of = room_of
        self.next_time_s = rule.first_look_s
        self.look = look
        self._looked_at_s = -math.inf
        self._period_s = getattr(rule.asked, "period_s", 0.0)

    def look_if_due(self, time_s: float) -> None:
        if time_s < self.next_time_s - _ROUNDING_S:
            return
        self.look_if_new(time_s)
        is_done = self.rule.error is not None
        self.next_time_s = math.inf if is_done else time_s + self._period_s

    def look_if_new(self, time_s: float) -> None:
        """Checks the requirement, unless it was checked at this simulated time already."""
        if time_s > self._looked_at_s and self.rule.error is None:
            self._looked_at_s = time_s
            was_violated = self.rule.violated_s is not None
            self.look(time_s)
            if not was_violated and self.rule.violated_s is not None:
                self._set_room()
                # The robot of a recording may drive already where that begins.
                self.rule.missed_at_start = time_s == 0 and self._room_of is not None

    def note_room(self) -> None:
        """Sets the room of a requirement that is missed at the end of the run only, such as a goal."""
        if self.rule.violated_s is None and self.rule.is_reached is False:
            self._set_room()

    def _set_room(self) -> None:
        self.rule.room = None if self._room_of is None else self._room_of(self.rule)


def make_rules(requirements: Sequence[JobRequirement]) -> list[Rule[Any]]:
    """Returns a rule for each requirement, in their order, which judges it during the run."""
    rules = [requirement.rule(requirement) for requirement in requirements]
    for index, rule in enumerate(rules):
        rule.follow(rules[:index])
    return rules


def merged(requested: Sequence[JobRequirement], own: Sequence[JobRequirement]) -> list[JobRequirement]:
    """Returns the requirements of environment and job together; the job's take precedence where names are equal."""
    names = {requirement.name for requirement in requested}
    return [*(requirement for requirement in own if requirement.name not in names), *requested]


def _own_requirements(environment: Any) -> list[JobRequirement]:
    """Returns the requirements that the environment itself has, besides those of the job.

    Raises:
        RequirementError: The environment's `requirements` are not a list of requirements.
    """
    ask = getattr(environment, "requirements", None)
    if ask is None:
        return []
    if not callable(ask):
        raise RequirementError(
            f"environment.requirements is of type {type(ask).__name__}; it has to be a method that returns a list"
        )
    try:
        return parse_requirements(ask(), "environment.requirements()")
    except InvalidParameterException as error:
        raise RequirementError(str(error)) from None


def _world_of(plan: RunPlan) -> World | None:
    if plan.world_dir is None:
        return None
    return World.model_validate_json((plan.world_dir / "world.json").read_bytes())


def _show_nothing() -> None:
    """Does nothing: the rules see the present poses without it."""


def _both(first: Callable[[], None] | None, second: Callable[[], None]) -> Callable[[], None]:
    def call() -> None:
        if first is not None:
            first()
        second()

    return call


def _metrics(rules: Sequence[Rule[Any]]) -> dict[str, float]:
    """Returns the metrics of all requirements that have one and could be judged, for tables and comparisons."""
    metrics: dict[str, float] = {}
    for rule in rules:
        if rule.error is None:
            rule.add_metrics(metrics)
    return metrics
