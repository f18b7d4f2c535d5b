"""Gymnasium environment to train policies in: a robot in a world, as in a simulation job."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import gettempdir
from typing import Any, ClassVar

import dm_env
import numpy as np
from dm_env import specs
from numpy.typing import NDArray

from ....schemas.extras import how_to_install
from ....schemas.runs.plan import ApplicationPlan, RunPlan
from ....schemas.runs.variables import TIME_LIMIT_VARIABLE
from ....schemas.wire.errors import ConfigurationError
from ....schemas.worlds.world import WORLD_FILE, World
from ..applications.indoor_navigation.environment import make_environment as indoor_navigation
from ..episode.context import SimulationContext
from ..episode.run_results import read_report
from ..recording.recording import Recorder
from ..robots.robot import CONTROL_TIMESTEP_S
from ..robots.robot_lookup import ROBOT_VARIABLE
from .arrays import Observed, ObservedArrays, checked_action, number_type, single_action

try:
    import gymnasium
    from gymnasium import spaces
except ImportError as error:
    raise ConfigurationError(
        f"environments for training need gymnasium, which cannot be imported here ({error}); "
        f"{how_to_install('gymnasium')}"
    ) from None

_SEEDS = 2**63
"""Upper limit of the seeds that are drawn for episodes without a seed."""

MakeEnvironment = Callable[[SimulationContext], dm_env.Environment]


class RobotEnv(gymnasium.Env[Any, NDArray[Any]]):
    """Gymnasium environment of a robot in a world, identical to that of a simulation job, for training.

    Observations are a `Dict` of arrays and the action is a `Box`, as the environment's specs say. An episode that
    reaches the limit of simulated time is truncated, any other end terminates it. The `info` of its last step has the
    verdict, a summary and the metrics of a job's result.

    Args:
        world: Folder of a world's bundle; None: the simulation needs none.
        robot: `scout`, `walker`, `menagerie:<model>`, or the path of a `robot.yaml`.
        time_limit_s: Simulated time in seconds that ends an episode; None: a limit that fits the world.
        variables: Environment variables of launch configurations.
        simulation: Factory function of the environment, as in simulation applications.

    Raises:
        LaunchError: The world or robot does not exist.
    """

    metadata: ClassVar[dict[str, Any]] = {  # pyright: ignore[reportIncompatibleVariableOverride]
        "render_modes": [],
        "render_fps": round(1 / CONTROL_TIMESTEP_S),
    }

    def __init__(
        self,
        world: Path | str | None = None,
        robot: Path | str = "scout",
        *,
        time_limit_s: float | None = None,
        variables: Mapping[str, str] | None = None,
        simulation: MakeEnvironment = indoor_navigation,
    ) -> None:
        self._context = _context(world, robot, time_limit_s, variables or {})
        self._make = simulation
        self._environment = simulation(self._context)
        self._arrays = ObservedArrays(self._environment.observation_spec())
        self._action = single_action(self._environment.action_spec(), "of a gymnasium environment")
        self.observation_space = spaces.Dict({name: _space(spec) for name, spec in self._arrays.specs.items()})
        self.action_space = _box(self._action)
        self._is_over = True

    @property
    def environment(self) -> dm_env.Environment:
        """The dm_env environment that this gymnasium environment wraps."""
        return self._environment

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Starts an episode, and returns its first observation and an empty dictionary.

        Args:
            seed: Makes the episode the same as in a simulation job with this seed; absent: one is drawn.
            options: Ignored.
        """
        super().reset(seed=seed, options=options)
        if seed is None:
            seed = int(self.np_random.integers(_SEEDS))
        self._context = replace(self._context, rng=np.random.default_rng(seed))
        renew = getattr(self._environment, "renew", None)
        if renew is not None:
            renew(self._context)
        else:
            self._environment.close()
            self._environment = self._make(self._context)
        timestep = self._environment.reset()
        self._is_over = False
        return self._arrays.read(timestep.observation), {}

    def step(self, action: NDArray[Any]) -> tuple[Observed, float, bool, bool, dict[str, Any]]:
        """Does one control step; returns observation, reward, whether the episode ended or was cut short, and facts.

        Raises:
            RobotProgramError: The action does not fit the environment's action spec, or is not finite.
            gymnasium.error.ResetNeeded: The episode is over.
        """
        if self._is_over:
            raise gymnasium.error.ResetNeeded("the episode is over, or none has begun; call reset first")
        timestep = self._environment.step(checked_action(action, self._action, "the caller"))
        observed, reward = self._arrays.read(timestep.observation), float(timestep.reward or 0.0)
        self._is_over = timestep.last()
        if not self._is_over:
            return observed, reward, False, False, {}
        is_truncated = bool(timestep.discount) or self._is_out_of_time()
        return observed, reward, not is_truncated, is_truncated, self._result()

    def close(self) -> None:
        """Closes the wrapped environment; no episode can be started afterwards."""
        self._environment.close()

    def _is_out_of_time(self) -> bool:
        limit_s = getattr(self._environment, "time_limit_s", None)
        physics = getattr(self._environment, "physics", None)
        return limit_s is not None and physics is not None and float(physics.data.time) >= limit_s - 1e-6

    def _result(self) -> dict[str, Any]:
        report = read_report(self._environment)
        return {"verdict": report.verdict, "summary": report.summary, "metrics": dict(report.metrics)}


def _context(
    world: Path | str | None, robot: Path | str, time_limit_s: float | None, variables: Mapping[str, str]
) -> SimulationContext:
    """Returns the context that a job's factory functions would get, without an output folder or a recording.

    Raises `ConfigurationError` if the world's folder has no world file.

    Args:
        world: Folder of the world's bundle; `None`: no world.
        robot: Name of a robot, or path of a `robot.yaml`.
        time_limit_s: Time limit of an episode in simulated seconds; `None`: the environment's default.
        variables: Environment variables of the job.
    """
    world_dir = Path(world).absolute() if world is not None else None
    if world_dir is not None and not (world_dir / WORLD_FILE).is_file():
        raise ConfigurationError(f"world: {world_dir} has no {WORLD_FILE}; give the folder of a world's bundle")
    mapping = Path(robot).absolute() if str(robot).endswith((".yaml", ".yml")) else None
    application = mapping and ApplicationPlan(role="robot", name=mapping.parent.name or "robot", path=mapping.parent)
    environment = {**variables, ROBOT_VARIABLE: str(robot) if mapping is None else mapping.name}
    if time_limit_s is not None:
        environment[TIME_LIMIT_VARIABLE] = str(time_limit_s)
    nowhere = Path(gettempdir())
    plan = RunPlan(
        job_id="gymnasium",
        job_arn="",
        run_id="gymnasium",
        seed=0,
        max_duration_s=float("inf"),
        world_dir=world_dir,
        work_dir=nowhere,
        output_dir=nowhere,
        robot_application=application,
        record=False,
    )
    return SimulationContext(
        plan=plan,
        rng=np.random.default_rng(0),
        world=World.model_validate_json((world_dir / WORLD_FILE).read_bytes()) if world_dir is not None else None,
        world_dir=world_dir,
        data_dir=None,
        output_dir=nowhere,
        environment=environment,
        recorder=Recorder(),
    )


def _space(spec: specs.Array) -> "spaces.Space[Any]":
    return spaces.MultiBinary(spec.shape) if spec.dtype == np.bool_ else _box(spec)


def _box(spec: specs.Array) -> spaces.Box:
    dtype = number_type(spec)
    limits = (-np.inf, np.inf) if dtype.kind == "f" else (np.iinfo(dtype).min, np.iinfo(dtype).max)
    low, high = (getattr(spec, name, limit) for name, limit in zip(("minimum", "maximum"), limits, strict=True))
    low, high = (np.broadcast_to(np.asarray(each, dtype), spec.shape).copy() for each in (low, high))
    return spaces.Box(low, high, spec.shape, dtype.type)
