"""Reproduction folder of a run: its inputs, its outcome, and a test that repeats the run."""

import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from ....schemas.runs.plan import Requirement, RunOutcome, RunPlan, VideoPolicy
from ....schemas.runs.provenance import Provenance
from ....schemas.runs.trials import OF_ALL_TRIALS
from ..states.provenance import machine_facts
from ..supervision.launcher import Launcher
from .replay import RunOutputs, read_outputs, rerun_plan, why_not_comparable, why_other_inputs

PLAN_FILE = "plan.json"
FIRST_OUTPUTS = "first"
"""Name of the subfolder with the outputs of the original run."""

_MOST_OF_NAME = 200
_TEST = '''\
"""Repeats run {run_id} of {job_id}, which {words}{how}.

    python -m pytest {name}

Written by `robomaker repro`; what it repeats is in this folder.
"""

from pathlib import Path

import pytest

from prefect_robomaker.tasks.runtime.replay.repro import Reproduction, Rerun, is_expected

REPRODUCTION = Reproduction(Path(__file__).parent)


@pytest.fixture(scope="module")
def rerun(tmp_path_factory: pytest.TempPathFactory) -> Rerun:
    return REPRODUCTION.rerun(tmp_path_factory.mktemp("rerun"))


def test_it_ends_as_it_did(rerun: Rerun) -> None:
    assert is_expected(rerun.ending, {ending!r}), rerun.ending


def test_its_states_are_the_same(rerun: Rerun) -> None:
    if reasons := REPRODUCTION.why_not_comparable(rerun):
        pytest.skip("not comparable: " + "; ".join(reasons))
    assert rerun.state_digest == {digest!r}
'''


@dataclass(frozen=True)
class Rerun:
    """A rerun of a recorded run that has ended: its outcome, its outputs, and their folder."""

    outcome: RunOutcome
    outputs: RunOutputs
    folder: Path
    """Folder of the rerun's outputs."""

    @property
    def ending(self) -> dict[str, Any]:
        """Outcome of the rerun for comparison: verdict and missed requirements, or failure code; see `ending_of`."""
        return ending_of(self.outputs, self.outcome.failure_code)

    @property
    def state_digest(self) -> str | None:
        """Hash of the rerun's simulation states; `None` without physics."""
        digest = self.outputs.provenance.digest
        return digest.value if digest else None


class Reproduction:
    """A folder with everything to repeat a run, written by `write_reproduction`, which can be run again."""

    def __init__(self, folder: Path) -> None:
        """Opens the reproduction folder of a run, and reads what is to be repeated.

        Args:
            folder: Path of the folder; it may have been moved, also to another machine.

        Raises:
            FileNotFoundError: The folder is not one that `write_reproduction` wrote.
        """
        self.folder = folder.resolve()
        plan = RunPlan.model_validate_json((self.folder / PLAN_FILE).read_bytes())
        self.plan = plan.with_paths(lambda path: self.folder / path)

    @cached_property
    def first(self) -> RunOutputs:
        """Outputs of the original run."""
        return read_outputs(self.folder / FIRST_OUTPUTS)

    def why_not_comparable(self, rerun: Rerun) -> list[str]:
        """Lists reasons for which a rerun on this machine may have other states than the run; there may be none."""
        return why_not_comparable(self.first.provenance.machine, machine_facts()) + self.other_inputs(rerun)

    def other_inputs(self, rerun: Rerun) -> list[str]:
        """Lists inputs of a rerun that differ from the run's, such as a changed application."""
        return why_other_inputs(self.first.provenance, rerun.outputs.provenance)

    def rerun(self, folder: Path, video: VideoPolicy = "none", launcher: Launcher | None = None) -> Rerun:
        """Runs the reproduced run again, in separate processes, waits for its end, and returns the rerun.

        Args:
            folder: Folder for the rerun's work and outputs; an earlier rerun in it is removed.
            video: Whether a video is recorded.
            launcher: Launcher of the rerun's processes; absent: a new one for this rerun.

        Raises:
            LaunchError: The run cannot be started on this machine.
        """
        plan = rerun_plan(self.plan, self.first, folder, video)
        for each in (plan.work_dir, plan.output_dir):
            shutil.rmtree(each, ignore_errors=True)
        if self.plan.root_dir is not None:
            # Applications may write below their root, and the next rerun begins as the first did.
            root = shutil.copytree(self.plan.root_dir, folder / "root", symlinks=True, dirs_exist_ok=True)
            plan = plan.model_copy(update={"root_dir": root})
        with nullcontext(launcher) if launcher else Launcher() as starting:
            outcome = starting.run(plan, lambda: None)
        return Rerun(outcome, read_outputs(plan.output_dir), plan.output_dir)


def ending_of(outputs: RunOutputs, failure_code: str | None) -> dict[str, Any]:
    """Returns a run's outcome for comparison: verdict, missed requirements and cause of the end, or failure code.

    The failure code, which may be `None`, is all that a run without a result has.
    """
    if outputs.result is None:
        return {"failure_code": failure_code}
    missed = missed_names(outputs.result.requirements)
    return {"verdict": outputs.result.verdict, "missed": missed, "ended_by": outputs.result.ended_by}


def missed_names(requirements: Sequence[Requirement]) -> list[str]:
    """Returns the names of the missed requirements, without those that are switched off or do not count.

    Args:
        requirements: All requirements of a run's result; one of a job with trials has `trials` first.
    """
    has_trials = any(each.name == OF_ALL_TRIALS for each in requirements)
    return [each.name for each in requirements if not each.satisfied and not each.is_aside(of_trials=has_trials)]


def rerun_ending(outputs: RunOutputs, failure_code: str | None) -> dict[str, Any]:
    """Returns the outcome that an identical rerun must have.

    A cancelled run has no verdict; its rerun ends by itself at the same time, and has one.
    """
    ending = ending_of(outputs, failure_code)
    if ending.get("ended_by") == "canceled":
        return {"missed": ending["missed"], "ended_by": "duration limit"}
    return ending


def is_expected(ending: Mapping[str, Any], expected: Mapping[str, Any]) -> bool:
    """Whether a rerun's outcome has all members of the expected one, with the same values."""
    return all(ending.get(name) == value for name, value in expected.items())


def in_words(ending: dict[str, Any]) -> str:
    """Formats the outcome of a simulation run as a predicate, to follow a subject such as `The rerun`.

    Examples: `ended with verdict FAIL (upright, gentle)`, `failed with RobotApplicationCrash`, `was canceled`.
    """
    if "failure_code" in ending:
        return f"failed with {ending['failure_code']}"
    if "verdict" not in ending:
        return "was canceled"
    missed = f" ({', '.join(ending['missed'])})" if ending["missed"] else ""
    return f"ended with verdict {ending['verdict']}{missed}"


def write_reproduction(plan: RunPlan, first: Path, failure_code: str | None, folder: Path) -> Path:
    """Writes a folder from which a run can be repeated on any machine; all of it, or nothing.

    Args:
        plan: The run, with folders of this machine.
        first: Folder with the outputs of the run, at least `provenance.json`.
        failure_code: Failure code of the run's job, if it has one.
        folder: Path of the new folder.

    Returns:
        The test that repeats it.

    Raises:
        FileExistsError: The folder is one already, or has something of a name that is needed.
        OSError: A file cannot be copied.
    """
    if (folder / PLAN_FILE).exists():
        raise FileExistsError(f"{folder}: holds a reproduction already; name another folder")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as scratch:
        unfinished = Path(scratch)
        shutil.copytree(first, unfinished / FIRST_OUTPUTS)
        moved = _copied(plan, unfinished)
        test = _write_test(read_outputs(unfinished / FIRST_OUTPUTS), failure_code, unfinished)
        (unfinished / PLAN_FILE).write_text(moved.model_dump_json(indent=1) + "\n")
        _move_all(unfinished, folder)
    return folder / test.name


def _move_all(source: Path, folder: Path) -> None:
    """Moves the content of a folder to another one, the plan last: its presence marks a complete reproduction.

    Raises `FileExistsError`, and moves nothing, if a file is there already.
    """
    folder.mkdir(exist_ok=True)
    names = sorted((path.name for path in source.iterdir()), key=lambda name: name == PLAN_FILE)
    if taken := [name for name in names if (folder / name).exists()]:
        raise FileExistsError(f"{folder}: has {', '.join(taken)} already; name another folder")
    for name in names:
        (source / name).rename(folder / name)


def _write_test(outputs: RunOutputs, failure_code: str | None, folder: Path) -> Path:
    provenance: Provenance = outputs.provenance
    ending = rerun_ending(outputs, failure_code)
    name = f"test_repro_{re.sub(r'[^A-Za-z0-9_]', '_', provenance.plan.job_id)[:_MOST_OF_NAME]}.py"
    text = _TEST.format(
        run_id=_in_docstring(provenance.plan.run_id),
        job_id=_in_docstring(provenance.plan.job_id),
        words=_in_docstring(in_words(ending)),
        how=", and whose robot is replayed from its recorded actions" if outputs.actions else "",
        name=name,
        ending=ending,
        digest=provenance.digest.value if provenance.digest else None,
    )
    path = folder / name
    path.write_text(text)
    return path


def _in_docstring(text: str) -> str:
    """Returns text that cannot end a docstring, as texts of a run are untrusted."""
    return text.replace("\\", "/").replace('"', "'")


def _copied(plan: RunPlan, folder: Path) -> RunPlan:
    """Copies the files that a run plan names into a folder, and returns the plan with paths relative to that folder."""
    places: dict[Path, Path] = {}

    def copy(source: Path | None, name: str) -> Path | None:
        # Two applications may come from one bundle, and must go on to.
        if source is not None and source not in places:
            places[source] = Path(name)
            shutil.copytree(source, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        return places[source] if source is not None else None

    applications = {
        name: application.model_copy(update={"path": copy(application.path, f"applications/{application.role}")})
        for name in ("simulation_application", "robot_application")
        if (application := getattr(plan, name)) is not None
    }
    folders = {
        "world_dir": copy(plan.world_dir, "world"),
        "data_dir": copy(plan.data_dir, "data"),
        "root_dir": copy(plan.root_dir, "root"),
        "work_dir": Path("work"),
        "output_dir": Path("output"),
        "checkpoint_dir": None,
    }
    return plan.model_copy(update={**folders, **applications})
