"""Provenance of a run: everything its numbers depend on, and the hash of its states."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import hashlib
import os
import platform
import sys
from collections.abc import Callable, Sequence
from functools import lru_cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import mujoco

from ....schemas.runs.plan import ApplicationPlan, RunPlan
from ....schemas.runs.policies import parse_policy
from ....schemas.runs.provenance import PROVENANCE_FILE, ActionsSummary, ApplicationDigest, MachineFacts, Provenance
from ....schemas.runs.variables import without_secrets
from ...files.untrusted_files import write_anew
from ..episode.physics import raw_physics
from ..episode.run_results import Findings, Observer
from .digest import DIGEST_FILE, LOOK_EVERY_S, StateDigest
from .imported_code import digest_of_code, digest_of_file, digest_of_folder, imported_code

_DISTRIBUTIONS = {
    "mujoco": "mujoco",
    "dm_control": "dm-control",
    "numpy": "numpy",
    "scipy": "scipy",
    "prefect_robomaker": "prefect-robomaker",
}
_CPU_FEATURES = frozenset({"sse4_2", "avx", "avx2", "fma", "avx512f", "avx512vl", "avx512dq", "asimd", "sve"})
"""CPU features by which MuJoCo, NumPy and the C library choose between code that rounds differently."""
_OF_PACKAGE = "__init__.py"

Actions = Callable[[], ActionsSummary | None]
"""Function that returns the summary of a completed action log; None if there is no log."""


class ProvenanceRecorder(Observer):
    """Observer that writes `provenance.json`, and the state hashes in `digest.bin`.

    `provenance.json` is written at the first call, so that a run that is killed has one, too.
    """

    def __init__(
        self, plan: RunPlan, applications: Sequence[ApplicationPlan] = (), actions: Actions | None = None
    ) -> None:
        """Prepares the provenance of a run, and the hash chain over its states.

        Args:
            plan: Plan of the run.
            applications: Applications that make environment and agent, built-in ones included.
            actions: Function that summarises a robot program's action log at the end; absent: the robot is no program.
        """
        self._plan = plan
        self._applications = applications
        self._actions = actions
        self._digest = StateDigest(plan.output_dir / DIGEST_FILE)
        self._data: mujoco.MjData | None = None
        self._has_begun = False
        self._world_sha256: str | None = None
        self._resumed_at_s: list[float] = []

    def watch(self, environment: Any, time_s: float) -> None:
        """Adds the current state to the state hashes; the first time, also writes the provenance file."""
        model, data = raw_physics(environment.physics)
        self._digest.look(model, data)
        self.next_time_s = time_s + LOOK_EVERY_S
        self._data = data
        if not self._has_begun:
            self._has_begun = True
            self._write()

    def hear(self, state: bytes, time_s: float) -> None:
        """Adds a state that an environment without physics gives to the state hashes, as `watch` does for physics."""
        self._digest.look_at(state, time_s)
        if not self._has_begun:
            self._has_begun = True
            self._write()

    def close(self, ended_by: str | None) -> Findings:
        """Completes both files, and returns the state hash for the result.

        Args:
            ended_by: Cause of the run's end; None if it failed. The applications of a cancelled run are not hashed, for
                lack of time.
        """
        digest = self._digest.finish(self._data)
        applications = [] if ended_by == "canceled" else _digests_of(self._applications, self._plan.root_dir)
        actions = self._actions() if self._actions is not None else None
        imported = {} if ended_by == "canceled" else _imported_by(self._applications)
        self._write(digest=digest, ended_by=ended_by, applications=applications, imported=imported, actions=actions)
        return Findings(state_digest=digest.value if digest else None)

    def state(self) -> dict[str, Any]:
        """Returns the state of the hash chain, and the times at which the run was resumed, for a checkpoint."""
        return {
            "next_time_s": self.next_time_s,
            "digest": self._digest.state(),
            "world_sha256": self._world_sha256,
            "resumed_at_s": self._resumed_at_s,
        }

    def restore(self, state: dict[str, Any], environment: Any) -> None:
        """Restores the hash chain from a checkpoint's state.

        Adds the simulated time in seconds to those at which the run was resumed, and writes the provenance file.
        """
        model, data = raw_physics(environment.physics)
        self._data, self._has_begun = data, True
        self.next_time_s = state["next_time_s"]
        self._digest.restore(state["digest"], model)
        self._world_sha256 = state["world_sha256"]
        self._resumed_at_s = [*state["resumed_at_s"], float(data.time)]
        self._write()

    def _write(self, **members: Any) -> None:
        if self._world_sha256 is None and self._plan.world_dir is not None:
            self._world_sha256 = digest_of_folder(self._plan.world_dir)
        _write_provenance(
            self._plan,
            world_sha256=self._world_sha256,
            model_sha256=self._digest.model_sha256,
            positions=self._digest.positions,
            joints=self._digest.joints,
            resumed_at_s=self._resumed_at_s,
            **members,
        )


def note_run(plan: RunPlan, applications: Sequence[ApplicationPlan] = (), ended_by: str | None = None) -> None:
    """Writes `provenance.json` for a run without an episode, or with trials.

    Args:
        plan: Plan of the run.
        applications: Applications that make environments and agents, once the run has ended.
        ended_by: Cause of the run's end; None: it continues.

    Raises:
        OSError: The file cannot be written.
    """
    _write_provenance(
        plan,
        world_sha256=digest_of_folder(plan.world_dir) if plan.world_dir else None,
        applications=_digests_of(applications, plan.root_dir),
        imported=_imported_by(applications) if applications else {},
        ended_by=ended_by,
    )


@lru_cache(maxsize=1)
def machine_facts() -> MachineFacts:
    """Returns the facts about this machine and its software that can change a run's numbers, looked up once."""
    cpu_model, features = _cpu()
    return MachineFacts(
        python=platform.python_version(),
        system=f"{platform.system()} {platform.machine()}",
        cpu_model=cpu_model,
        cpu_features=features,
        libc=_libc(),
        versions={name: metadata.version(distribution) for name, distribution in _DISTRIBUTIONS.items()},
    )


def _write_provenance(plan: RunPlan, **members: Any) -> None:
    provenance = Provenance(plan=without_secrets(plan), machine=machine_facts(), **members)
    write_anew(plan.output_dir / PROVENANCE_FILE, provenance.model_dump_json(indent=1).encode() + b"\n")


def _digests_of(applications: Sequence[ApplicationPlan], root: Path | None) -> list[ApplicationDigest]:
    """Returns the hashes of all applications with files on this machine.

    Container images need none, since the plan has their ids. Recorded actions need no program. The files of data
    sources are below the root folder; `None`: that of this machine.
    """
    found = [(each, _content_of(each, root)) for each in applications]
    return [
        ApplicationDigest(role=each.role, name=each.name, attribute=each.attribute, content=what[0], sha256=what[1])
        for each, what in found
        if what is not None
    ]


def _imported_by(applications: Sequence[ApplicationPlan]) -> dict[str, str]:
    return imported_code(sys.modules, [each.path for each in applications if each.path is not None])


def _content_of(application: ApplicationPlan, root: Path | None) -> tuple[Literal["bundle", "module"], str] | None:
    """Returns the kind (bundle or module) and the hash of an application's content; `None` if it is not known."""
    policy = _digest_of_policy(application, root)
    if application.path is not None:
        bundle = digest_of_folder(application.path)
        return "bundle", bundle if policy is None else hashlib.sha256(f"{bundle} {policy}".encode()).hexdigest()
    if policy is not None:  # the factory of its agent is this package's, whose version is recorded
        return "module", policy
    if application.attribute is not None:
        return "module", _digest_of_module(application.attribute)
    if application.package is not None and (sha256 := _digest_of_package(application.package)):
        return "module", sha256
    return None


def _digest_of_policy(application: ApplicationPlan, root: Path | None) -> str | None:
    """Returns the hash of an application's policy; `None`: it has none, or the policy is in the application's archive.

    The hash is empty if the policy was not found.
    """
    if application.policy is None:
        return None
    policy = parse_policy(application.policy)
    if policy.file is not None and policy.file.startswith("/"):
        file = (root or Path("/")) / policy.file.lstrip("/")
        return digest_of_file(file) if file.is_file() else ""
    if application.path is not None:
        return None
    name = (policy.module or "").partition(".")[0]
    is_own = name == __name__.partition(".")[0]
    return _digest_of_module(policy.module or "") if is_own else digest_of_code(name, sys.modules)


def _digest_of_module(attribute: str) -> str:
    """Returns the hash of the Python files of an imported module's package, or of the module's file.

    The hash is empty if the module could not be imported.
    """
    name = attribute
    while name not in sys.modules:
        name, _, last = name.rpartition(".")
        if not last:
            return ""  # it could not be imported
    origin = sys.modules[name].__file__
    return _digest_of_python(origin, is_package="." in name or Path(origin or "").name == _OF_PACKAGE)


def _digest_of_package(name: str) -> str:
    """Computes the hash of the Python files of an installed package without importing it."""
    spec = find_spec(name.partition(".")[0])
    origin = spec.origin if spec else None
    return _digest_of_python(origin, is_package=Path(origin or "").name == _OF_PACKAGE)


def _digest_of_python(origin: str | None, *, is_package: bool) -> str:
    if origin is None:
        return ""
    if is_package:
        return digest_of_folder(Path(origin).parent, ".py")
    return hashlib.sha256(Path(origin).read_bytes()).hexdigest()


def _cpu() -> tuple[str, list[str]]:
    """Returns the processor's name, and its features that influence rounding."""
    try:
        lines = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
    except OSError:  # no Linux
        return platform.processor(), []
    facts = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    features = _CPU_FEATURES.intersection((facts.get("flags") or facts.get("Features", "")).split())
    return facts.get("model name") or platform.processor() or platform.machine(), sorted(features)


def _libc() -> str:
    try:
        return os.confstr("CS_GNU_LIBC_VERSION") or "unknown"
    except (ValueError, OSError):
        return " ".join(platform.libc_ver()) or "unknown"
