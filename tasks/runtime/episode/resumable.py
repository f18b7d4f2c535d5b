"""Helps environments and agents to be resumed; see `checkpoints.Resumable`."""

from typing import Any, ClassVar

from dm_control.rl import control


class KeepsAttributes:
    """Keeps the attributes that are named in `KEPT`: what changes during a run and cannot be worked out again."""

    KEPT: ClassVar[tuple[str, ...]] = ()

    def state(self) -> dict[str, Any]:
        """Returns them."""
        return {name: getattr(self, name) for name in self.KEPT}

    def restore(self, state: dict[str, Any]) -> None:
        """Puts them back."""
        for name in self.KEPT:
            setattr(self, name, state[name])


class ResumableEnvironment(control.Environment):
    """dm_control's environment, if its task has `state()` and `restore(state)`."""

    def state(self) -> dict[str, Any]:
        """Returns the task's state, and how many steps there were."""
        return {"steps": self._step_count, "task": self._task.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Goes on from there."""
        self._step_count, self._reset_next_step = state["steps"], False
        self._task.restore(state["task"])
