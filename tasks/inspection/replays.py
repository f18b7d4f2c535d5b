"""Repeats a stored run on this machine, to compare its states or to examine it."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.runs.plan import RunOutcome, RunPlan, VideoPolicy
from ...schemas.runs.verification import Divergence, ReproductionFolder, RobotRepeat, Verification
from ...schemas.wire.errors import ConfigurationError, LaunchError, ResourceNotFoundException
from ..catalog import Resource
from ..jobs.job_runs import launcher
from ..runtime.replay.commands import first_other_command
from ..runtime.replay.replay import (
    RunOutputs,
    first_difference,
    read_outputs,
    rerun_plan,
    result_difference,
    why_not_comparable,
    why_not_repeatable,
    why_other_inputs,
    without_robot_programs,
)
from ..runtime.replay.repro import Reproduction, in_words, is_expected, rerun_ending, write_reproduction
from ..runtime.states.provenance import machine_facts
from ..service.service import Service
from ..simulations.containers.cleanup import remove_containers
from ..simulations.inputs.bundles import earlier_bundle
from ..simulations.planning.run_plans import run_plan
from ..simulations.ros.ros_domains import own_domain
from ..storage import MANIFEST_NAME
from .found_runs import FoundRun, found_run, found_trial, plan_of_found_trial, scratch_folder

_MOST_ALTERATIONS = 10


def verify_run(
    reference: str, service: Service, *, trial: int | None = None, run_program: bool = False
) -> Verification:
    """Repeats a simulation run on this machine and compares all simulation states with the recorded ones.

    A robot program is not run again: its recorded actions are played back, in the robot of its archive.

    Args:
        reference: ARN or id of a simulation job, `s3://bucket/prefix` or a folder of outputs.
        service: The service, with its catalog and object store.
        trial: Number of the trial, if the job has trials; None: the first one that did not pass, else the first one.
        run_program: Whether a robot program is run again nevertheless.

    Raises:
        ConfigurationError: The reference is not that of a run, or of a trial of one.
        ResourceNotFoundException: The catalog has no such job.
        StorageError: The outputs of the run cannot be read.
    """
    with found_run(reference, service) as run, scratch_folder(service) as scratch, own_domain(reference) as ros_domain:
        whole, run = run, found_trial(run, trial)
        first = run.outputs
        reasons = [
            *why_not_repeatable(first, run_program=run_program),
            *_without_states(first),
            *why_not_comparable(first.provenance.machine, machine_facts()),
        ]
        if reasons:
            return _verification(reference, first, reasons)
        if run_program:
            first = replace(first, actions=None)
        try:
            outcome, again = _run_again(replace(run, outputs=first), scratch, service, ros_domain)
        except (LaunchError, FileNotFoundError) as error:
            return _verification(reference, first, [f"it cannot be run here: {error}"])
        if again.timeline is None:
            return _verification(reference, first, [f"its rerun came to no state: {outcome.failure_reason}"])
        answer = _compared(reference, first, again)
        if run_program:
            answer = _with_command(answer, run.outputs, again)
        return _with_manifest(answer, whole.alterations(run.outputs.provenance.plan.trial))


def _run_again(run: FoundRun, scratch: Path, service: Service, ros_domain: int) -> tuple[RunOutcome, RunOutputs]:
    """Repeats a run, with its robot program unless there are recorded actions.

    Raises:
        FileNotFoundError: The run did not start.
        LaunchError: The run cannot be repeated on this machine.
    """
    inputs = scratch / "inputs"
    try:
        plan = plan_here(run, inputs, service, ros_domain)
        # Where a program is run it finds the folders that it was planned with; a container has them mounted.
        folders = {"work_dir": plan.work_dir, "output_dir": plan.output_dir} if plan.programs else {}
        plan = rerun_plan(plan, run.outputs, scratch / "rerun").model_copy(update=folders)
        outcome = launcher().run(plan, lambda: None)
    finally:
        remove_containers(inputs)
    return outcome, read_outputs(plan.output_dir)


def reproduce_run(
    reference: str, folder: Path, service: Service, video: VideoPolicy = "always", trial: int | None = None
) -> ReproductionFolder:
    """Downloads everything a simulation run needs, runs it again, and writes a test that repeats it.

    Args:
        reference: Reference to the run; see `verify_run`.
        folder: Path of the new folder; it must not exist, or must not contain a reproduction.
        service: Service that stores the run.
        video: Whether the rerun gets a video.
        trial: Number of the trial, if the job has trials; None: the first one that did not pass, else the first one.

    Raises:
        ConfigurationError: The reference names no run, or the folder is taken, or no rerun could repeat the run.
        LaunchError: A file that the run needs cannot be downloaded, or the run cannot be started on this machine.
        ResourceNotFoundException: The catalog has no such job.
        StorageError: The outputs of the run cannot be read.
    """
    with found_run(reference, service) as run, scratch_folder(service) as scratch, own_domain(reference) as ros_domain:
        run = found_trial(run, trial)
        if reasons := why_not_repeatable(run.outputs):
            raise ConfigurationError(f"{reference} cannot be repeated: {'; '.join(reasons)}")
        plan = plan_here(run, scratch / "inputs", service, ros_domain)
        _check_modules(reference, plan)
        try:
            test = write_reproduction(plan, run.folder, run.failure_code, folder)
        except FileExistsError as error:
            raise ConfigurationError(str(error)) from error
    reproduction = Reproduction(folder)
    rerun = reproduction.rerun(reproduction.folder / "rerun", video, launcher())
    video_file = rerun.folder / "video.mp4"
    return ReproductionFolder(
        trial=run.outputs.provenance.plan.trial,
        folder=reproduction.folder,
        test=test.resolve(),
        video=video_file if video_file.exists() else None,
        ending=in_words(rerun.ending),
        same_ending=is_expected(rerun.ending, rerun_ending(reproduction.first, run.failure_code)),
        other_inputs=reproduction.other_inputs(rerun),
        robot=_robot_in_rerun(reproduction.first),
    )


def _check_modules(reference: str, plan: RunPlan) -> None:
    """Checks that Python finds the installed modules of a run's applications here.

    Raises:
        ConfigurationError: One is missing; the error says how its folder is given. A rerun would only say that it
            failed, or that the application is another one.
    """
    for each in (plan.simulation_application, plan.robot_application):
        if each is None or each.attribute is None or each.path is not None:
            continue
        module = each.attribute.partition(".")[0]
        if find_spec(module) is None:
            raise ConfigurationError(
                f"{reference} cannot be repeated here: the Python module {module} of the {each.role} application "
                f"{each.name} is not found; install it, or name the folder that {module} is in: "
                "PYTHONPATH=FOLDER robomaker repro …"
            )


def _compared(reference: str, first: RunOutputs, again: RunOutputs) -> Verification:
    if reasons := why_other_inputs(first.provenance, again.provenance):
        return _verification(reference, first, reasons)
    difference = first_difference(first, again)
    answer = _verification(reference, first, [])
    if difference is None and (what := result_difference(first.result, again.result)):
        difference = Divergence(time_s=answer.until_s or 0.0, equal_until_s=answer.until_s, what=what)
    digest = again.provenance.digest
    return answer.model_copy(
        update={
            "answer": "diverged" if difference else "bit-identical",
            "divergence": difference,
            "digest_again": digest.value if digest else None,
        }
    )


def _with_command(verification: Verification, first: RunOutputs, again: RunOutputs) -> Verification:
    """Adds the first command that differs to a verification, unless the states differed before.

    One that is not about a run with recorded commands, or whose commands are equal, is returned as it is.
    """
    difference = verification.divergence
    if difference is None or first.actions is None or again.actions is None:
        return verification
    found = first_other_command(first.actions, again.actions)
    if found is None:
        return verification
    at_s = found.time_s(first.result.sim_time_s if first.result is not None else verification.until_s or 0.0)
    if at_s >= difference.time_s > 0:
        return verification
    command = f"{found.name} at step {found.number + 1} ({at_s:.2f} s): {found.values}"
    return verification.model_copy(update={"divergence": difference.model_copy(update={"command": command})})


def _with_manifest(verification: Verification, alterations: list[str]) -> Verification:
    """Adds output files that were changed after the run to a verification of it, which then says that the run diverged.

    A verification that is not bit-identical, or without changed files, is returned as it is.
    """
    if verification.answer != "bit-identical" or not alterations:
        return verification
    more = len(alterations) - _MOST_ALTERATIONS
    told = [*alterations[:_MOST_ALTERATIONS], *([f"and {more} more"] if more > 0 else [])]
    what = f"in its outputs: {', '.join(told)}; {MANIFEST_NAME} has other content"
    at_s = verification.until_s or 0.0
    difference = Divergence(time_s=at_s, equal_until_s=verification.until_s, what=what)
    return verification.model_copy(update={"answer": "diverged", "divergence": difference})


def _verification(reference: str, first: RunOutputs, reasons: list[str]) -> Verification:
    provenance, timeline, digest = first.provenance, first.timeline, first.provenance.digest
    looks, until_s = (digest.looks, digest.until_s) if digest else (0, None)
    if timeline is not None:
        looks, until_s = len(timeline.links), float(timeline.times_s[-1]) if timeline.links else None
    return Verification(
        run=reference,
        job_arn=provenance.plan.job_arn,
        run_id=provenance.plan.run_id,
        trial=provenance.plan.trial,
        answer="not comparable",
        reasons=reasons,
        looks=looks,
        until_s=until_s,
        digest=digest.value if digest else None,
        robot=_robot_in_rerun(first),
    )


def _robot_in_rerun(first: RunOutputs) -> RobotRepeat:
    if not first.provenance.plan.has_robot_program:
        return "factory"
    return "program" if first.actions is None else "recorded actions"


def _without_states(first: RunOutputs) -> list[str]:
    if (first.timeline is not None and first.timeline.links) or not first.provenance.plan.has_episode:
        return []
    if first.provenance.plan.trial is not None and first.provenance.digest is not None:
        return []  # the row of a trial has the digest of its states, not the states
    return ["it kept no states: its environment has no physics and no `state()` that gives bytes, or it ended before"]


def plan_here(run: FoundRun, folder: Path, service: Service, ros_domain: int) -> RunPlan:
    """Returns the run's plan with folders of this machine: from its job, else the original plan if its folders exist.

    Raises:
        LaunchError: A file that the run needs cannot be downloaded.
    """
    plan = run.outputs.provenance.plan
    if run.outputs.actions is not None:
        plan = _with_robot_files(without_robot_programs(plan), run.job, service)
    if run.job is not None:
        try:
            return plan_of_found_trial(_plan_of_job(run.job, plan, folder, service, ros_domain), plan)
        except ResourceNotFoundException as error:
            raise LaunchError(str(error), "ResourceNotFound") from error
    if plan.programs:
        raise LaunchError(
            f"the catalog does not know its job {plan.job_arn} any more, which says how its programs are started",
            "ResourceNotFound",
        )
    applications = [each for each in (plan.simulation_application, plan.robot_application) if each is not None]
    wanted = [plan.world_dir, plan.data_dir, *(each.path for each in applications)]
    if missing := [str(path) for path in wanted if path is not None and not path.is_dir()]:
        raise LaunchError(
            f"the catalog does not know its job {plan.job_arn} any more, and {', '.join(missing)} is not here",
            "ResourceNotFound",
        )
    return plan


def _with_robot_files(plan: RunPlan, job: Resource | None, service: Service) -> RunPlan:
    """Returns a plan whose robot application has the folder with its archive here.

    It has none if the archive that the run had is gone: most environments do not miss it.
    """
    robot = plan.robot_application
    if robot is None or robot.path is None or (job is None and robot.path.is_dir()):
        return plan
    etag = _archives_of(job, plan)["robot"] if job is not None else robot.path.name
    folder = earlier_bundle(etag, "Robot", service)
    return plan.model_copy(update={"robot_application": robot.model_copy(update={"path": folder})})


def _plan_of_job(job: Resource, plan: RunPlan, folder: Path, service: Service, ros_domain: int) -> RunPlan:
    """Makes the plan from the job's request; for recorded actions, no program or image of the robot is looked for."""
    if not plan.has_robot_program or plan.programs:
        return run_plan(job, plan.run_id, folder, service, ros_domain, as_ran=_archives_of(job, plan))
    document = SimulationJobDocument.of(job)
    request = {name: value for name, value in document.request.items() if name != "robotApplications"}
    job = replace(job, document=document.model_copy(update={"request": request}).to_json())
    planned = run_plan(job, plan.run_id, folder, service, ros_domain, as_ran=_archives_of(job, plan))
    return planned.model_copy(update={"robot_application": plan.robot_application})


def _archives_of(job: Resource, plan: RunPlan) -> dict[str, str]:
    """ETags of the archives that a run had, by role; what the catalog says of it comes before its outputs."""
    document = SimulationJobDocument.of(job)
    # The folder of an unpacked archive is called by the ETag; that of an installed package is not asked for.
    plans = {"robot": plan.robot_application, "simulation": plan.simulation_application}
    found = {role: each.path.name for role, each in plans.items() if each is not None and each.path is not None}
    if document.run_id == plan.run_id and document.made_of is not None:
        found |= document.made_of.etags
    return found
