"""Running a stored run again: to compare its states, or to take it apart on this machine."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from ..schemas.arns import ResourceArn
from ..schemas.errors import (
    ConfigurationError,
    LaunchError,
    ObjectNotFoundError,
    ResourceNotFoundException,
    StorageError,
)
from ..schemas.provenance import PROVENANCE_FILE
from ..schemas.simulation_run import RunPlan, VideoPolicy
from ..schemas.verification import ReproductionFolder, Verification
from .catalog import Resource
from .job_runs import launcher
from .run_plans import run_plan
from .runtime.digest import DIGEST_FILE
from .runtime.provenance import machine_facts
from .runtime.replay import (
    RunOutputs,
    first_difference,
    read_outputs,
    rerun_plan,
    why_not_comparable,
    why_not_repeatable,
    why_other_inputs,
)
from .runtime.repro import Reproduction, ending_of, in_words, write_reproduction
from .runtime.results import RESULT_FILE
from .service import Service
from .storage.naming import join_key

_KIND = "simulation-job"
_WRITTEN_DOWN = (PROVENANCE_FILE, DIGEST_FILE, RESULT_FILE)


@dataclass(frozen=True)
class FoundRun:
    """A run, with what it wrote down on this machine."""

    outputs: RunOutputs
    folder: Path
    """What it wrote down; only that, not all of its outputs."""
    job: Resource | None
    """Its job, while the catalog has it."""


def verify_run(reference: str, service: Service) -> Verification:
    """Runs a run again on this machine and compares all states; neither job nor outputs are touched.

    Args:
      reference: ARN or id of a simulation job, `s3://bucket/prefix` or a folder of outputs.
      service: where it is stored.

    Raises:
      ConfigurationError: that names no run.
      ResourceNotFoundException: there is no such job.
      StorageError: its outputs cannot be read.
    """
    with _found(reference, service) as run, _scratch(service) as scratch:
        first = run.outputs
        reasons = [
            *why_not_repeatable(first.provenance.plan),
            *_without_physics(first),
            *why_not_comparable(first.provenance.machine, machine_facts()),
        ]
        if reasons:
            return _verification(reference, first, reasons)
        try:
            plan = rerun_plan(_plan_here(run, scratch / "inputs", service), first.provenance, scratch / "rerun")
            launcher().run(plan, lambda: None)
            again = read_outputs(plan.output_dir)
        except (LaunchError, FileNotFoundError) as error:
            return _verification(reference, first, [f"it cannot be run here: {error}"])
        return _compared(reference, first, again)


def reproduce_run(reference: str, folder: Path, service: Service, video: VideoPolicy = "always") -> ReproductionFolder:
    """Fetches all that a run needs into a folder, runs it again and writes a test that does so.

    Args:
      reference: see `verify_run`.
      folder: where to; it must be absent or hold no reproduction.
      service: where the run is stored.
      video: whether the rerun is filmed.

    Raises:
      ConfigurationError: the reference names no run, or the folder is taken, or no rerun could repeat the run.
      LaunchError: something that it needs cannot be had, or it cannot be started here.
      ResourceNotFoundException: there is no such job.
      StorageError: its outputs cannot be read.
    """
    with _found(reference, service) as run, _scratch(service) as scratch:
        if reasons := why_not_repeatable(run.outputs.provenance.plan):
            raise ConfigurationError(f"{reference} cannot be repeated: {'; '.join(reasons)}")
        failure_code = run.job.document.get("failureCode") if run.job else None
        plan = _plan_here(run, scratch / "inputs", service)
        try:
            test = write_reproduction(plan, run.folder, failure_code, folder)
        except FileExistsError as error:
            raise ConfigurationError(str(error)) from error
    reproduction = Reproduction(folder)
    rerun = reproduction.rerun(reproduction.folder / "rerun", video, launcher())
    film = rerun.folder / "video.mp4"
    return ReproductionFolder(
        folder=reproduction.folder,
        test=test.resolve(),
        video=film if film.exists() else None,
        ending=in_words(rerun.ending),
        same_ending=rerun.ending == ending_of(reproduction.first, failure_code),
    )


def _compared(reference: str, first: RunOutputs, again: RunOutputs) -> Verification:
    if reasons := why_other_inputs(first.provenance, again.provenance):
        return _verification(reference, first, reasons)
    difference = first_difference(first, again)
    answer = _verification(reference, first, [])
    digest = again.provenance.digest
    return answer.model_copy(
        update={
            "answer": "diverged" if difference else "bit-identical",
            "divergence": difference,
            "digest_again": digest.value if digest else None,
        }
    )


def _verification(reference: str, first: RunOutputs, reasons: list[str]) -> Verification:
    provenance, timeline = first.provenance, first.timeline
    return Verification(
        run=reference,
        job_arn=provenance.plan.job_arn,
        run_id=provenance.plan.run_id,
        answer="not comparable",
        reasons=reasons,
        looks=len(timeline.links) if timeline else 0,
        until_s=float(timeline.times_s[-1]) if timeline and timeline.links else None,
        digest=provenance.digest.value if provenance.digest else None,
    )


def _without_physics(first: RunOutputs) -> list[str]:
    if first.timeline is not None and first.timeline.links:
        return []
    return ["it kept no states: its environment has no physics, or it ended before the first"]


# Finding it


@contextmanager
def _found(reference: str, service: Service) -> Iterator[FoundRun]:
    """Finds a run, and fetches what it wrote down into a folder that is there inside the block."""
    with _scratch(service) as scratch:
        job = _job_of(reference, service)
        if job is not None:
            _fetch_of_job(job, scratch, service)
        elif reference.startswith("s3://"):
            bucket, _, prefix = reference.removeprefix("s3://").partition("/")
            _fetch(bucket, prefix.rstrip("/"), scratch, service)
        else:
            _copy(Path(reference), scratch)
        outputs = _read(scratch, reference)
        if job is None:
            job = service.catalog.get_many([outputs.provenance.plan.job_arn]).get(outputs.provenance.plan.job_arn)
        yield FoundRun(outputs, scratch, job)


def _job_of(reference: str, service: Service) -> Resource | None:
    if reference.startswith("arn:"):
        return service.catalog.get(str(ResourceArn.parse(reference, _KIND)), kind=_KIND)
    if reference.startswith("sim-") and "/" not in reference and not Path(reference).exists():
        return service.catalog.get(service.arn(_KIND, reference), kind=_KIND)
    return None


def _fetch_of_job(job: Resource, folder: Path, service: Service) -> None:
    """Fetches what the last run of a job wrote down, from the store or from this machine."""
    document = job.document
    run_id = document.get("runId")
    kept = service.settings.home / "jobs" / job.id / str(run_id) / "output"
    if place := document.get("outputs"):
        _fetch(place["bucket"], place["prefix"], folder, service)
    elif kept.is_dir():
        _copy(kept, folder)
    else:
        raise ConfigurationError(f"{job.arn} has no outputs: it is {job.status}, and none are on this machine")


def _fetch(bucket: str, prefix: str, folder: Path, service: Service) -> None:
    for name in _WRITTEN_DOWN:
        try:
            service.store.get_file(bucket, join_key(prefix, name), folder / name)
        except ObjectNotFoundError:
            continue  # runs without physics and failed ones lack some


def _copy(outputs: Path, folder: Path) -> None:
    if not outputs.is_dir():
        raise ConfigurationError(
            f"{str(outputs)!r} is no run: name the ARN or the id of a simulation job, s3://BUCKET/PREFIX or a folder"
        )
    for name in _WRITTEN_DOWN:
        if (outputs / name).is_file():
            shutil.copyfile(outputs / name, folder / name)


def _read(folder: Path, reference: str) -> RunOutputs:
    try:
        return read_outputs(folder)
    except FileNotFoundError as error:
        raise ConfigurationError(
            f"{reference}: there is no {PROVENANCE_FILE} in its outputs; it ended before it ran, or was run by an "
            "earlier version"
        ) from error
    except ValidationError as error:
        raise StorageError(f"{reference}: its outputs cannot be read: {error.errors()[0]['msg']}") from error
    except ValueError as error:
        raise StorageError(f"{reference}: its outputs cannot be read: {error}") from error


def _plan_here(run: FoundRun, folder: Path, service: Service) -> RunPlan:
    """The run's plan with folders of this machine: from its job, else as it was while those folders are still here.

    Raises:
      LaunchError: something cannot be had.
    """
    plan = run.outputs.provenance.plan
    if run.job is not None:
        try:
            return run_plan(run.job, plan.run_id, folder, service)
        except ResourceNotFoundException as error:
            raise LaunchError(str(error), "ResourceNotFound") from error
    applications = [each for each in (plan.simulation_application, plan.robot_application) if each is not None]
    wanted = [plan.world_dir, plan.data_dir, *(each.path for each in applications)]
    if missing := [str(path) for path in wanted if path is not None and not path.is_dir()]:
        raise LaunchError(
            f"the catalog does not know its job {plan.job_arn} any more, and {', '.join(missing)} is not here",
            "ResourceNotFound",
        )
    return plan


@contextmanager
def _scratch(service: Service) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="replay-", dir=service.folder("scratch")) as folder:
        yield Path(folder)
