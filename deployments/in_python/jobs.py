"""Simulation jobs of a run: outcomes and stored outputs."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO, cast

from markupsafe import Markup

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace
from ...schemas.reports.run_record import CaseOutcome, JobRecord, case_outcome
from ...schemas.runs.plan import Requirement, RunResult, Verdict
from ...schemas.wire.common import counted
from ...schemas.wire.errors import ObjectNotFoundError, ResourceNotFoundException, RobomakerError
from ...schemas.wire.request_problems import first_words, nearest
from ...tasks.comparison.compared_runs import TRIALS
from ...tasks.runtime.episode.run_results import RESULT_FILE
from ...tasks.service.service import Service
from ...tasks.storage import read_manifest
from ...tasks.storage.object_store import join_key
from .html import badge, card, folded, line, table
from .rows import NamedValues
from .worlds import World


@dataclass(frozen=True)
class Job:
    """Simulation job of a run, or a request that has no job."""

    record: JobRecord
    """Record of the job: requirements, metrics, inputs and more."""
    world: World | None
    """World that a simulation job used; `None`: none."""
    _service: Service = field(repr=False, compare=False)

    def __repr__(self) -> str:
        """Describes the job in one line."""
        return f"<Job {self.id}, {self.title}: {self.outcome}>"

    @property
    def id(self) -> str:
        """Id of the job, or `request 3` for a request without a job."""
        return self.record.label

    @property
    def name(self) -> str:
        """Name of the job, the same in every run of the specification."""
        return self.record.test or self.record.label

    @property
    def title(self) -> str:
        """Name for people, unique in the run: `scout in flat 3`."""
        return self.record.name or self.name

    @property
    def status(self) -> str:
        """Status in the service; for a request without a job `NotCreated`, or `Pending` if one may still come."""
        return self.record.status

    @property
    def outcome(self) -> CaseOutcome:
        """Outcome of a simulation job; only `passed` means that it was judged and met all its requirements."""
        return case_outcome(self.record.status, self.record.verdict, self.record.failure_code)

    @property
    def verdict(self) -> Verdict | None:
        """Verdict of the job; `None`: it did not end by itself, or has not ended."""
        return self.record.verdict if self.record.status == "Completed" else None

    @property
    def reason(self) -> str:
        """Reason why the job did not pass, in words; empty: unknown, or it passed."""
        return self.record.failure_reason or self.record.verdict_reason or self.record.failure_code or ""

    @property
    def known(self) -> str:
        """Owner, last day and reason of the job's failure if the specification knows it; else empty."""
        return self.record.known

    @cached_property
    def outputs(self) -> dict[str, str]:
        """Addresses of its output files by name, `file:///…` or `s3://…`; empty while nothing is stored.

        A name that it lacks raises an `UnknownNameError`, a `KeyError` that has the names.

        Raises:
            ResourceNotFoundException: The job was deleted.
            StorageError: The object store does not answer.
        """
        place = self._place
        if place is None:
            return NamedValues("output", {})
        store = self._service.store
        uris = {name: store.uri(place.bucket, join_key(place.prefix, name)) for name in self._names(place)}
        return NamedValues("output", uris)

    def result(self) -> RunResult:
        """Reads the job's `result.json`: verdict, requirements, metrics, rooms, collisions and path.

        Raises:
            ResourceNotFoundException: No job came of the request, or it was deleted.
            ObjectNotFoundError: It has stored no result.
            StorageError: The object store does not answer.
        """
        with self.open(RESULT_FILE) as file:
            result = RunResult.model_validate_json(file.read())
        return result.unjudged() if self.status == "Canceled" else result

    def open(self, name: str) -> BinaryIO:
        """Opens one of the job's outputs for reading, as a seekable binary file.

        Args:
            name: Name of the output, such as `recording.mcap`; `outputs` has all names.

        Raises:
            ResourceNotFoundException: No job came of the request, or it was deleted.
            ObjectNotFoundError: It has no output of that name; the message says which there are.
            StorageError: The object store does not answer.
        """
        if self.record.arn is None:
            why = "has not become a job yet" if self.status == "Pending" else f"never became a job: {self.reason}"
            raise ResourceNotFoundException(f"{self.id} of step {self.record.step} {why}")
        place = self._place
        if place is None or name not in self.outputs:
            raise ObjectNotFoundError(self._nothing(name))
        key = join_key(place.prefix, name)
        path = self._service.store.local_path(place.bucket, key)
        if path is not None and path.is_file() and not path.is_symlink():
            return path.open("rb")
        with TemporaryDirectory(dir=self._service.folder("scratch")) as folder:
            copy = Path(folder, "output")
            self._service.store.get_file(place.bucket, key, copy)
            return cast("BinaryIO", copy.open("rb"))  # an open file stays readable when its folder is gone

    def _nothing(self, name: str) -> str:
        if not self.outputs:
            why = f": {self.reason}" if self.reason else ""
            return f"{self.id} has no output {name!r}: it is {self.status} and has stored nothing{why}"
        there = first_words(sorted(self.outputs))
        return f"{self.id} has no output {name!r}{nearest(name, self.outputs)}; there are {there}"

    @property
    def _place(self) -> StoredPlace | None:
        if self.record.arn is None:
            return None
        return SimulationJobDocument.of(self._service.catalog.get(self.record.arn)).outputs

    def _names(self, place: StoredPlace) -> list[str]:
        store = self._service.store
        try:
            return [file.path for file in read_manifest(store, place.bucket, place.prefix).files]
        except ObjectNotFoundError:  # it crashed or was killed, or still runs: its logs may be there
            prefix = f"{place.prefix}/"
            return [item.key.removeprefix(prefix) for item in store.list(place.bucket, prefix)]

    def _repr_html_(self) -> str:
        of_trials = any(each.name == TRIALS for each in self.record.requirements)
        requirements = [
            (
                each.name,
                badge(_standing_of(each)),
                each.detail,
                "does not count" if each.is_aside(of_trials=of_trials) else "",
            )
            for each in self.record.requirements
        ]
        try:
            outputs = folded(counted(len(self.outputs), "output"), "\n".join(sorted(self.outputs)))
        except RobomakerError as error:
            outputs = line(f"outputs not known: {error}")
        return str(
            card(
                self.title,
                self.outcome,
                line(self.reason),
                table(("requirement", "outcome", "detail", ""), requirements),
                table((), [("world", self.world.name)] if self.world else []),
                outputs,
                self.world.drawing() if self.world else Markup(""),
                own_id=self.id,
            )
        )


def _standing_of(requirement: Requirement) -> str:
    if requirement.error is not None:
        return "broken"
    return "passed" if requirement.satisfied else "failed"
