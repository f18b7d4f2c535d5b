"""Agent that follows a policy: a Python callable or an ONNX file."""

import importlib.util
import inspect
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import dm_env
import numpy as np

from ....schemas.runs.policies import PolicyReference, parse_policy
from ..episode.context import SimulationContext
from ..episode.loading import LoadError, add_to_import_path, load_factory
from .arrays import NotFiniteError, Observed, ObservedArrays, checked_action, single_action
from .onnx_file import OnnxPolicy

_STATE = ("state", "restore")

Policy = Callable[[Observed], Any]


def make_agent(context: SimulationContext, environment: dm_env.Environment) -> "PolicyAgent":
    """Makes the agent that drives the robot by the policy of a simulation job.

    Raises:
        LoadError: The policy cannot be found or loaded, or takes other observations; the text says why.
    """
    application = context.plan.robot_application
    assert application is not None, "the plan names the policy in its robot application"
    assert application.policy is not None, "the plan names the policy in its robot application"
    return PolicyAgent(application.policy, application.path, context.plan.root_dir, environment)


class PolicyAgent:
    """Agent that drives the robot by a policy, which it calls with each observation.

    Args:
        policy: Policy as the specification names it.
        folder: Folder of the robot application's files; None: it has none.
        root: Folder that the job sees as `/`, for absolute paths; None: the root of this machine.
        environment: Environment, whose specs define observations and actions.

    Raises:
        LoadError: The policy cannot be found, read or fed.
    """

    def __init__(self, policy: str, folder: Path | None, root: Path | None, environment: dm_env.Environment) -> None:
        self._name = policy
        self._arrays = ObservedArrays(environment.observation_spec())
        self._action = single_action(environment.action_spec(), policy)
        reference = parse_policy(policy)
        if reference.is_onnx:
            self._policy: Policy = OnnxPolicy(_file(reference, folder, root), policy, self._arrays, self._action)
        else:
            self._policy = _callable(reference, folder, root)
        if all(callable(getattr(self._policy, name, None)) for name in _STATE):
            # Only then: a run is continued from its checkpoints if its agent says what it remembers.
            self.state, self.restore = (getattr(self._policy, name) for name in _STATE)

    def __call__(self, timestep: dm_env.TimeStep) -> Any:
        """Calls the policy with a time step's observation, and returns its action.

        Raises:
            RobotProgramError: The policy returned something else.
        """
        observed = self._arrays.read(timestep.observation)
        try:
            return checked_action(self._policy(observed), self._action, f"policy {self._name}")
        except NotFiniteError as error:
            if not (cause := _possible_cause(observed)):
                raise
            raise NotFiniteError(f"{error}; {cause}") from None


def _possible_cause(observed: Observed) -> str:
    """Says which of a policy's observations may have made its action not finite; empty if they all are finite."""
    unknown = [name for name, array in observed.items() if np.isnan(array).any()]
    if unknown:
        return f"it observed NaN in {', '.join(unknown)}, which may be the cause"
    # A lidar's ray that meets nothing is infinitely long, which networks make NaN of.
    endless = [name for name, array in observed.items() if np.isinf(array).any()]
    if endless:
        named = ", ".join(endless)
        return (
            f"infinite numbers in {named} are normal, and may be the cause: a policy has to limit those that it reads"
        )
    return ""


def _callable(reference: PolicyReference, folder: Path | None, root: Path | None) -> Policy:
    """Imports and returns the callable that a policy names; a class is instantiated first.

    Raises `LoadError` if it cannot be imported, or the instance cannot be called.
    """
    assert reference.attribute is not None
    try:
        if reference.module is not None:
            found = load_factory(f"{reference.module}.{reference.attribute}", folder)
        else:
            found = _attribute_of_file(_file(reference, folder, root), reference.attribute, folder)
    except LoadError as error:
        is_absent = str(error).startswith("there is no installed package")
        hint = (
            "; a module of your own is in a robot application's archive, or where PYTHONPATH says" if is_absent else ""
        )
        raise LoadError(f"policy {reference.text}: {error}{hint}") from error.__cause__
    policy = found() if inspect.isclass(found) else found
    if not callable(policy):
        raise LoadError(f"policy {reference.text}: an instance of it cannot be called; give its class a __call__")
    return policy


def _attribute_of_file(path: Path, attribute: str, folder: Path | None) -> Callable[..., Any]:
    if folder is not None:
        add_to_import_path(folder)  # so that it may import what is beside it
    name = f"robomaker_policy_{re.sub(r'[^0-9A-Za-z_]', '_', path.stem)}"  # files may be called `turn-away.v2.py`
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise LoadError(f"running {path.name} failed: {type(error).__name__}: {error}") from error
    try:
        return load_factory(f"{name}.{attribute}")
    except LoadError as error:
        raise LoadError(str(error).replace(f"{name}.{attribute}", attribute).replace(name, path.name)) from None


def _file(reference: PolicyReference, folder: Path | None, root: Path | None) -> Path:
    """Returns the path of a policy's file in a robot application's folder, or, if it is absolute, below a root folder.

    `None` as the root is `/`. Links that lead out of the folder count as absent.

    Raises:
        LoadError: The policy's file does not exist.
    """
    assert reference.file is not None
    is_absolute = reference.file.startswith("/")
    top = (root or Path("/")) if is_absolute else folder
    if top is None:
        raise LoadError(
            f"policy {reference.text}: files are read from archives of robot applications and from data sources, and "
            "this job's robot application is an installed package; package.module:function would be right"
        )
    path = top / reference.file.lstrip("/")
    # Names such as a link to `/etc` would lead out of it.
    if path.is_file() and path.resolve().is_relative_to(top.resolve()):
        return path
    there = sorted(each.relative_to(top).as_posix() for each in top.rglob(f"*{path.suffix}")) if not is_absolute else []
    listed = f"; the robot application has {', '.join(there[:8])}" if there else ""
    where = "the job's data sources have" if is_absolute else "the robot application has"
    raise LoadError(f"policy {reference.text}: {where} no file {reference.file}{listed}")
