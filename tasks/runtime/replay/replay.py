"""Replays a run: whether the rerun has to be identical, and how it is made so."""

from dataclasses import dataclass
from pathlib import Path

from ....schemas.runs.plan import RecordedActions, RunPlan, RunResult, VideoPolicy
from ....schemas.runs.provenance import PROVENANCE_FILE, MachineFacts, Provenance
from ..agents.action_log import ACTIONS_FILE, ActionLog, ActionLogError
from ..episode.program_names import program_in_words
from ..episode.results import RESULT_FILE
from ..states.digest import DIGEST_FILE, StateTimeline, read_timeline

STOPPED_FROM_OUTSIDE = ("duration limit", "canceled")
"""Ends that depend on the clock of a wall; a rerun ends at the same simulated time."""

_FACTS = {"python": "Python", "system": "the system", "libc": "the C library"}


@dataclass(frozen=True)
class RunOutputs:
    """Stored outputs of a run, as far as they exist."""

    provenance: Provenance
    timeline: StateTimeline | None
    """Absent when the run had no physics."""

    result: RunResult | None
    """Absent when the run failed."""

    actions: Path | None = None
    """Action log of a robot program; absent when the robot is no program, or has no log."""


def read_outputs(folder: Path) -> RunOutputs:
    """Reads a run's outputs.

    Raises:
        FileNotFoundError: There is no `provenance.json`.
        ValueError: A file is not what it should be.
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
    """Returns why a rerun may have other states, by the names of the causes; empty when it has to be identical.

    Recorded actions repeat a robot program, with all that its tools contributed.

    Args:
        run: The run.
        run_program: Whether the robot's program is run again, instead of what was recorded of it.
    """
    plan = run.provenance.plan
    programs = without_robot(plan).programs if run.actions is not None and not run_program else plan.programs
    if plan.has_robot_program:
        programs = [each for each in programs if each.kind == "tool"]
    reasons = [
        f"{program_in_words(each, plan)} is a program of its own: no seed repeats its timing" for each in programs
    ]
    if plan.has_robot_program:
        reasons = [*(_why_not_in_lockstep(run) if run_program else _why_no_actions(run)), *reasons]
    return reasons


def without_robot(plan: RunPlan) -> RunPlan:
    """Returns a plan that needs no robot application: its recorded actions take its place."""
    robot, nothing = plan.robot_application, {"path": None, "package": None}
    return plan.model_copy(
        update={
            "robot_application": robot.model_copy(update=nothing) if robot else None,
            "programs": [each for each in plan.programs if each.role != "robot"],
        }
    )


def why_not_comparable(one: MachineFacts, other: MachineFacts) -> list[str]:
    """Returns differences of two machines that can change the last bit of a number; a processor's name alone cannot."""
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
    """Returns inputs of a rerun that differ from the run's: another world, other applications, another seed."""
    there = {each.role: each.sha256 for each in one.applications}
    reasons = [
        f"the {each.role} application {each.name} is not what it was"
        for each in other.applications
        if there.get(each.role, each.sha256) != each.sha256
    ]
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


def _images(plan: RunPlan) -> dict[str, str]:
    """Returns ids of the container images of a run's applications, by their roles."""
    return {each.role: each.image_id for each in plan.programs if each.image_id is not None}


def rerun_plan(plan: RunPlan, of: RunOutputs, folder: Path, video: VideoPolicy = "none") -> RunPlan:
    """Makes the plan of a rerun: the same run in folders of its own, ended where the first was stopped.

    Args:
        plan: The run, with the folders of this machine.
        of: What the run wrote down; recorded actions in it take the place of the robot's program.
        folder: Where the rerun's own folders are made.
        video: Whether a video of the rerun is recorded.
    """
    first = of.provenance
    stopped = first.ended_by in STOPPED_FROM_OUTSIDE and first.digest is not None
    if of.actions is not None:
        plan = without_robot(plan)
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
    """Returns why the actions of a robot program cannot be repeated; empty when they can."""
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
    """Returns why even a deterministic robot program may act differently in a rerun; empty when it cannot."""
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
