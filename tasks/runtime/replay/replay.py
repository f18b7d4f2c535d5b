"""Reruns: whether a run can be repeated, the rerun's plan, and where the rerun first differs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ....schemas.runs.plan import RecordedActions, Requirement, RunPlan, RunResult, VideoPolicy
from ....schemas.runs.programs import TOPIC_RECORDER
from ....schemas.runs.provenance import PROVENANCE_FILE, JointPlace, MachineFacts, Provenance
from ....schemas.runs.verification import Divergence
from ..agents.action_log import ACTIONS_FILE, ActionLog, ActionLogError
from ..episode.progress import program_in_words
from ..episode.run_results import RESULT_FILE
from ..states.digest import DIGEST_FILE, StateTimeline, read_timeline

STOPPED_FROM_OUTSIDE = ("duration limit", "canceled")
"""Causes of a run's end that depend on wall-clock time; a rerun ends at the same simulated time."""

_FACTS = {"python": "Python", "system": "the system", "libc": "the C library"}


@dataclass(frozen=True)
class RunOutputs:
    """Output files of a run, parsed: provenance, state hashes and result, as far as they exist."""

    provenance: Provenance
    timeline: StateTimeline | None
    """Hashes of the run's states; absent if it had none: neither physics, nor an environment that gives them."""

    result: RunResult | None
    """Result of the run; absent if the run failed."""

    actions: Path | None = None
    """Path of the robot program's action log; absent if there is none."""


def read_outputs(folder: Path) -> RunOutputs:
    """Reads a run's output files.

    Raises:
        FileNotFoundError: The folder has no `provenance.json`.
        ValueError: A file has invalid content.
    """
    provenance = Provenance.model_validate_json((folder / PROVENANCE_FILE).read_bytes())
    digest, result, actions = (folder / name for name in (DIGEST_FILE, RESULT_FILE, ACTIONS_FILE))
    return RunOutputs(
        provenance=provenance,
        timeline=read_timeline(digest) if digest.exists() else None,
        result=RunResult.model_validate_json(result.read_bytes()) if result.exists() else None,
        actions=actions if provenance.plan.has_robot_program and actions.is_file() else None,
    )


def why_not_repeatable(run: RunOutputs, *, run_program: bool = False) -> list[str]:
    """Lists reasons for which a rerun may have other states; empty if it must be identical.

    Recorded actions repeat a robot program, including its tools.

    Args:
        run: Outputs of the run.
        run_program: Whether the robot program is run again instead of using its recorded actions.
    """
    plan = run.provenance.plan
    programs = without_robot_programs(plan).programs if run.actions is not None and not run_program else plan.programs
    if plan.has_robot_program:
        # The recorder of ROS topics is this package's own, and drives nothing.
        programs = [each for each in programs if each.kind == "tool" and not each.name.endswith(f".{TOPIC_RECORDER}")]
    reasons = [
        f"{program_in_words(each, plan)} is a program of its own: no seed repeats its timing" for each in programs
    ]
    if plan.has_robot_program:
        reasons = [*(_why_not_in_lockstep(run) if run_program else _why_no_actions(run)), *reasons]
    return reasons


def without_robot_programs(plan: RunPlan) -> RunPlan:
    """Returns a plan without the programs of the robot application, as recorded actions are to replace them.

    Its files stay: the environment takes the robot's model from them, and requirements may name functions in them.
    """
    return plan.model_copy(update={"programs": [each for each in plan.programs if each.role != "robot"]})


def why_not_comparable(one: MachineFacts, other: MachineFacts) -> list[str]:
    """Lists differences of two machines that can change the last bit of a number; empty if there are none.

    Args:
        one: Machine of the run.
        other: This machine.
    """
    reasons = [
        f"{words} is {getattr(one, name)} there and {getattr(other, name)} here"
        for name, words in _FACTS.items()
        if getattr(one, name) != getattr(other, name)
    ]
    if missing := sorted(set(one.cpu_features) - set(other.cpu_features)):
        reasons.append(f"this processor lacks {', '.join(missing)}")
    if more := sorted(set(other.cpu_features) - set(one.cpu_features)):
        reasons.append(f"this processor also has {', '.join(more)}")
    for name in sorted(one.versions.keys() | other.versions.keys()):
        there, here = one.versions.get(name, "absent"), other.versions.get(name, "absent")
        if there != here:
            reasons.append(f"{name} is {there} there and {here} here")
    return reasons


def why_other_inputs(one: Provenance, other: Provenance) -> list[str]:
    """Lists the inputs of a rerun that differ from the run's: world, applications, images, seed; empty if none does.

    A robot application whose recorded actions were played back counts only if the model is another one: its program was
    not run.

    Args:
        one: Provenance of the run.
        other: Provenance of the rerun.
    """
    is_same_robot = other.plan.recorded_actions is not None and one.model_sha256 == other.model_sha256
    there = {each.role: each.sha256 for each in one.applications if each.role != "robot" or not is_same_robot}
    reasons = [
        f"the {each.role} application {each.name} is not what it was"
        for each in other.applications
        if there.get(each.role, each.sha256) != each.sha256
    ]
    robot = other.plan.robot_application
    if "robot" in there and robot is not None and robot.path is None and robot.package is None:
        reasons += _why_no_archive(one.plan)
    images = _images(one.plan)
    reasons += [
        f"{program_in_words(each, other.plan)} is of another image than it was"
        for each in other.plan.programs
        if images.get(each.role, each.image_id) != each.image_id
    ]
    if one.world_sha256 != other.world_sha256:
        reasons.append("the world is not the one it ran in")
    if one.plan.seed != other.plan.seed:
        reasons.append(f"the seed was {one.plan.seed} and is {other.plan.seed}")
    return reasons


def _why_no_archive(plan: RunPlan) -> list[str]:
    """Returns the reason why a rerun lacks the robot's archive; empty if the run had none."""
    robot = plan.robot_application
    if robot is None or robot.attribute is not None or robot.path is None:
        return []
    return [f"the archive of robot application {robot.name} is not here any more, and its robot is another one without"]


def _images(plan: RunPlan) -> dict[str, str]:
    """Returns the container image ids of a run's applications, by role."""
    return {each.role: each.image_id for each in plan.programs if each.image_id is not None}


def rerun_plan(plan: RunPlan, of: RunOutputs, folder: Path, video: VideoPolicy = "none") -> RunPlan:
    """Makes the plan of a rerun: the same run in other folders, ended when the first one was stopped.

    Args:
        plan: Plan of the run, with the folders of this machine.
        of: Outputs of the run; recorded actions in them replace the robot program.
        folder: Parent folder of the rerun's folders.
        video: Whether a video of the rerun is recorded.
    """
    first = of.provenance
    stopped = first.ended_by in STOPPED_FROM_OUTSIDE and first.digest is not None
    if of.actions is not None:
        plan = without_robot_programs(plan)
    return plan.model_copy(
        update={
            "work_dir": folder / "work",
            "output_dir": folder / "output",
            "video": video,
            "ports": [],
            "checkpoint_dir": None,
            # This machine may be slower, or busier.
            "max_duration_s": plan.max_duration_s * 10 + 60,
            "end_at_s": first.digest.until_s if stopped and first.digest else None,
            "recorded_actions": _recorded_actions(of),
        }
    )


def _recorded_actions(of: RunOutputs) -> RecordedActions | None:
    if of.actions is None:
        return None
    if of.result is None:
        return RecordedActions(path=of.actions.absolute())
    stopped = of.provenance.ended_by in STOPPED_FROM_OUTSIDE
    return RecordedActions(path=of.actions.absolute(), ended_by="duration limit" if stopped else "agent")


def _why_no_actions(run: RunOutputs) -> list[str]:
    """Returns the reason why a robot program's actions cannot be played back; empty if they can."""
    about = _about_robot(run)
    if run.actions is None:
        return [f"{about} none of its actions were kept"]
    try:
        found = ActionLog(run.actions).summary()
    except (ActionLogError, OSError) as error:
        return [f"{about} its actions cannot be read: {error}"]
    kept = run.provenance.actions
    if kept is not None and kept != found:
        return [
            f"{about} {ACTIONS_FILE} is not what the run wrote: {found.actions} of {kept.actions} actions are whole"
        ]
    return []


def _why_not_in_lockstep(run: RunOutputs) -> list[str]:
    """Returns the reason why even a deterministic robot program may act differently in a rerun; empty if it cannot."""
    about = _about_robot(run)
    if run.actions is None:
        return [f"{about} whether the simulation waited for it is not known"]
    try:
        mode = ActionLog(run.actions).header.mode
    except ActionLogError as error:
        return [f"{about} whether the simulation waited for it is not known: {error}"]
    return [] if mode == "lockstep" else [f"{about} it ran free: what it did when depends on the clock of the wall"]


def _about_robot(run: RunOutputs) -> str:
    robot = run.provenance.plan.robot_application
    assert robot is not None
    return f"robot application {robot.name} is a program of its own, and"


@dataclass(frozen=True)
class JointNames:
    """Names of a model's joints, by which an index in a state vector is told to people."""

    joints: Sequence[JointPlace]
    positions: int
    """Number of positions; the velocities follow them in the state vector."""

    def of(self, index: int) -> tuple[str, Literal["qpos", "qvel"]]:
        """Returns the name of the joint at an index of the state vector, and whether it is a position or a velocity.

        The name is `unknown` if no joint has that index.
        """
        quantity: Literal["qpos", "qvel"] = "qpos" if index < self.positions else "qvel"
        place = index if quantity == "qpos" else index - self.positions
        owners = [joint for joint in self.joints if getattr(joint, quantity) <= place]
        return (max(owners, key=lambda joint: getattr(joint, quantity)).name if owners else "unknown"), quantity


def first_difference(one: RunOutputs, other: RunOutputs) -> Divergence | None:
    """Finds the first difference between the states of two runs.

    Args:
        one: Outputs of the run; the run may have been killed, then only its written states are compared.
        other: Outputs of the rerun.

    Returns:
        The first difference; None when all states are equal.
    """
    here, there = one.provenance, other.provenance
    if here.model_sha256 != there.model_sha256:
        return Divergence(time_s=0.0, what="in the model itself: its environment built another one")
    if one.timeline is None and here.plan.trial is not None:
        return _other_digest(one, other)
    if one.timeline is None or other.timeline is None:
        return None
    names = JointNames(here.joints, here.positions)
    return compare_timelines(one.timeline, other.timeline, names, whole=here.digest is not None)


def compare_timelines(
    one: StateTimeline, other: StateTimeline, names: JointNames, *, whole: bool = True
) -> Divergence | None:
    """Returns the first difference between the state histories of two runs of one model; `None` if there is none.

    Args:
        one: States of the run.
        other: States of the rerun.
        names: Names of the model's joints.
        whole: Whether the run was complete, so that the rerun has to end at the same step.
    """
    both = min(len(one.links), len(other.links))
    at = next((i for i in range(both) if one.links[i] != other.links[i]), None)
    if at is None:
        if len(other.links) < len(one.links) or (whole and len(other.links) > len(one.links)):
            return _other_end(one, other)
        return None
    time_s = float(min(one.times_s[at], other.times_s[at]))
    until_s = float(one.times_s[at - 1]) if at else None
    named = _name_joint(one.states, other.states, names, time_s)
    if named is None and not one.states:
        return Divergence(time_s=time_s, equal_until_s=until_s, what="in what the environment's state() gives")
    if named is None:
        what = "in no position or velocity that was kept: in controls, forces or solver state"
        return Divergence(time_s=time_s, equal_until_s=until_s, what=what)
    return named.model_copy(update={"time_s": time_s, "equal_until_s": until_s})


def _other_digest(one: RunOutputs, other: RunOutputs) -> Divergence | None:
    """Returns the difference between a trial and its rerun when only hashes of their states are kept.

    Returns `None` if there is none.
    """
    digest, again = one.provenance.digest, other.provenance.digest
    if digest is None or again is None or digest == again:
        return None
    what = "or before: of a trial only the digest of all its states is kept"
    return Divergence(time_s=min(digest.until_s, again.until_s), what=what)


def _other_end(one: StateTimeline, other: StateTimeline) -> Divergence:
    ends = [float(each.times_s[-1]) if len(each.times_s) else 0.0 for each in (one, other)]
    what = f"in its end: the run ended at {ends[0]:.3f} s, the rerun at {ends[1]:.3f} s"
    return Divergence(time_s=min(ends), equal_until_s=min(ends), what=what)


def _name_joint(
    one: Sequence[NDArray[np.float64]],
    other: Sequence[NDArray[np.float64]],
    names: JointNames,
    from_s: float,
) -> Divergence | None:
    """Names the joint that differs most in the first kept state that differs; `None` if no state does.

    Args:
        one: States of the run, each with its time in seconds first.
        other: States of the rerun.
        names: Names of the joints.
        from_s: Time from which on states are compared, in seconds.
    """
    for state, again in zip(one, other, strict=False):
        if state[0] < from_s or len(state) != len(again) or state[0] != again[0]:
            continue
        different = np.flatnonzero((state != again) & ~(np.isnan(state) & np.isnan(again)))
        if different.size:
            return _difference(state, again, different, names)
    return None


def _difference(
    state: NDArray[np.float64], again: NDArray[np.float64], different: NDArray[np.intp], names: JointNames
) -> Divergence:
    # Positions say more than velocities; where only velocities differ, they have to do.
    positions = different[different <= names.positions]
    candidates = positions if positions.size else different
    index = int(candidates[np.argmax(np.abs(state[candidates] - again[candidates]))])
    joint, quantity = names.of(index - 1)
    value, value_again, time_s = float(state[index]), float(again[index]), float(state[0])
    return Divergence(
        time_s=time_s,
        what=f"in joint {joint} ({quantity} {value!r} vs {value_again!r} at {time_s:.3f} s)",
        joint=joint,
        quantity=quantity,
        value=value,
        value_again=value_again,
        value_time_s=time_s,
    )


def result_difference(first: RunResult | None, again: RunResult | None) -> str | None:
    """Describes how the results of two runs with equal states differ; `None` if they do not.

    Equal states give equal results, unless a file was changed afterwards or a requirement judges something else.

    Args:
        first: Result of the run; None: it has none, as a failed run.
        again: Result of the rerun.
    """
    if first is None or again is None or again.ended_by == "canceled" or first.ended_by == "canceled":
        return None
    if first.verdict != again.verdict:
        return f"in its result: the verdict was {first.verdict} and is {again.verdict}"
    there, here = ({item.name: item for item in result.requirements} for result in (first, again))
    for name in [*there, *(name for name in here if name not in there)]:
        if (one := _judged(there.get(name))) != (other := _judged(here.get(name))):
            return f"in its result: {name} was {one} and is {other}"
    return None


def _judged(requirement: Requirement | None) -> str:
    """Describes how a requirement was judged, to compare two runs: met, missed or broken, and its margin.

    It is `absent` for `None`, a requirement that only the other run has.
    """
    if requirement is None:
        return "absent"
    judged = "met" if requirement.satisfied else "broken" if requirement.error is not None else "missed"
    return judged if requirement.margin is None else f"{judged} by {requirement.margin:g}"
