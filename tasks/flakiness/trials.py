"""Reruns of a job that has ended, in folders of their own: no catalog, history or comparison knows them."""

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from ...schemas.runs.plan import RunOutcome, RunPlan
from ...schemas.runs.programs import BoxPlan
from ...schemas.wire.errors import LaunchError
from ..inspection.found_runs import FoundRun
from ..inspection.replays import plan_here
from ..jobs.job_runs import launcher
from ..runtime.agents.action_log import ActionLog, ActionLogError
from ..runtime.process.run_request import RunRequest
from ..runtime.replay.replay import RunOutputs, read_outputs, rerun_plan, why_other_inputs
from ..service.service import Service
from ..simulations.containers.cleanup import remove_containers
from .causes import Hold, Weights
from .evidence import Observation
from .holding import Marks, held_request, programs_of, weights_of

_LEVELS = "prefect_robomaker.tasks.runtime.sandbox.levels"
_BOX_TIMEOUT_S = 30.0
"""Seconds for finding out whether this machine has boxes, which takes a fraction of one."""


class NotRerunError(Exception):
    """Raised when a job cannot be run again as it was; the message says why, as a clause."""


@dataclass(frozen=True)
class Trial:
    """One rerun with its outputs, which lie in the scratch folder until the search ends."""

    observation: Observation
    outputs: RunOutputs


@dataclass
class Trials:
    """Reruns of one job.

    Args:
        run: The run of the job, as it was stored.
        service: Service with the catalog and the object store.
        scratch: Folder for the reruns.
        ros_domain: Domain of ROS 2 of this process.
        has_neighbours: Whether another job ran at the same time as the run; a copy of the job stands for it.
        on_rerun: Called with the number of finished reruns.
    """

    run: FoundRun
    service: Service
    scratch: Path
    ros_domain: int
    has_neighbours: bool = False
    on_rerun: Callable[[int], None] = lambda _: None
    made: list[Trial] = field(default_factory=list[Trial])
    replays: int = 0
    _box: BoxPlan = field(default_factory=BoxPlan)
    _used: set[str] = field(default_factory=set[str])
    _is_watched: bool = True
    _begun: int = 0

    def try_out(self, hold: Hold) -> list[Observation]:
        """Runs the job again, with a copy beside where its neighbours are not held.

        Raises:
            NotRerunError: It cannot be run again as it was.
        """
        copies = 2 if self.has_neighbours and "order" not in hold.held else 1
        with ThreadPoolExecutor(copies) as pool:
            folders = [self._folder() for _ in range(copies)]
            trials = list(pool.map(lambda folder: self._run(hold, folder), folders))
        if not self.made and (reasons := self._other_inputs(trials[0].outputs)):
            raise NotRerunError("; ".join(reasons))
        self.made.extend(trials)
        self.on_rerun(len(self.made) + self.replays)
        return [each.observation for each in trials]

    def weights(self) -> Weights:
        """Returns the factors that can be held on this machine, weighted by what the reruns have used."""
        can_box = self._box.level == "box" or _has_boxes()
        return weights_of(
            self._used,
            is_watched=self._is_watched,
            box=self._box,
            can_box=can_box,
            has_neighbours=self.has_neighbours,
        )

    def replay(self, trial: Trial) -> Trial:
        """Runs the simulation again with the commands of a rerun.

        Raises:
            NotRerunError: The simulation cannot be run again.
        """
        self.replays += 1
        run = replace(self.run, outputs=trial.outputs)
        outcome, outputs = self._carry_out(run, self._folder(), lambda request, _: request)
        self.on_rerun(len(self.made) + self.replays)
        return Trial(observation_of(Hold(frozenset()), outcome, outputs), outputs)

    @property
    def have_states(self) -> bool:
        """Whether the simulation gives its states; without them only commands and ends are compared."""
        return any(each.outputs.provenance.digest is not None for each in self.made)

    @property
    def first_end(self) -> str | None:
        """Verdict of the run itself, or its failure code; None: it left no result."""
        result = self.run.outputs.result
        return result.verdict if result else self.run.failure_code

    def first_observation(self) -> Observation | None:
        """Returns how the run itself ended, with nothing held; None: that, or its commands, are not there any more."""
        if (verdict := self.first_end) is None or not has_all_commands(self.run.outputs):
            return None
        return Observation(frozenset(), verdict, _bits(verdict, self.run.outputs))

    def _folder(self) -> Path:
        self._begun += 1
        return self.scratch / str(self._begun)

    def _run(self, hold: Hold, folder: Path) -> Trial:
        marked: list[tuple[Marks, list[str]]] = []

        def adjust(request: RunRequest, marks: Marks) -> RunRequest:
            self._box = request.box
            marked.append((marks, programs_of(request)))
            return held_request(request, hold, marks)

        # Its robot drives again: no recorded actions take its place.
        run = replace(self.run, outputs=replace(self.run.outputs, actions=None))
        outcome, outputs = self._carry_out(run, folder, adjust)
        marks, programs = marked[0]
        self._used |= marks.used()
        self._is_watched = self._is_watched and marks.are_watched(programs)
        held = marks.held(hold.held, programs)
        return Trial(observation_of(hold.only(held)._replace(held=held), outcome, outputs), outputs)

    def _carry_out(
        self, run: FoundRun, folder: Path, adjust: Callable[[RunRequest, Marks], RunRequest]
    ) -> tuple[RunOutcome, RunOutputs]:
        inputs = folder / "inputs"
        try:
            planned = plan_here(run, inputs, self.service, self.ros_domain)
            folders = {"work_dir": planned.work_dir, "output_dir": planned.output_dir} if planned.programs else {}
            plan: RunPlan = rerun_plan(planned, run.outputs, folder / "rerun").model_copy(update=folders)
            marks = Marks(plan.work_dir / ".held")
            outcome = launcher().run(plan, lambda: None, adjust=lambda request: adjust(request, marks))
            return outcome, read_outputs(plan.output_dir)
        except (LaunchError, FileNotFoundError) as error:
            raise NotRerunError(f"it cannot be run here: {error}") from error
        finally:
            remove_containers(inputs)

    def _other_inputs(self, again: RunOutputs) -> Sequence[str]:
        return why_other_inputs(self.run.outputs.provenance, again.provenance)


def observation_of(hold: Hold, outcome: RunOutcome, outputs: RunOutputs) -> Observation:
    """Returns what is compared of a rerun: its verdict (without a result its failure code or status) and its bits."""
    verdict = outputs.result.verdict if outputs.result else outcome.failure_code or outcome.status
    return Observation(hold.held, verdict, _bits(verdict, outputs), hold.values)


def _bits(verdict: str, outputs: RunOutputs) -> str:
    """Returns the hash of a run's commands and states, and of its verdict."""
    digest = hashlib.sha256(verdict.encode())
    if outputs.actions is not None:
        for action in ActionLog(outputs.actions):
            digest.update(action)
    states = outputs.provenance.digest
    digest.update(states.value.encode() if states is not None else b"")
    return digest.hexdigest()


def has_all_commands(outputs: RunOutputs) -> bool:
    """Returns whether a run's log of commands is what the run wrote, or it wrote none."""
    written = outputs.provenance.actions
    if written is None:
        return True
    try:
        return outputs.actions is not None and ActionLog(outputs.actions).summary() == written
    except (ActionLogError, OSError):
        return False


def _has_boxes() -> bool:
    """Returns whether jobs of this machine can run in a box, though they do not.

    A machine that does not say so in time counts as one without: the search goes on with what it can hold.
    """
    try:
        tried = subprocess.run(
            [sys.executable, "-m", _LEVELS], capture_output=True, text=True, check=False, timeout=_BOX_TIMEOUT_S
        )
    except (subprocess.TimeoutExpired, OSError):
        return False
    return tried.returncode == 0 and json.loads(tried.stdout)["level"] == "box"
