"""Applies the values of a trial's axes to an environment, and checks that they stay in effect."""

import math
from collections.abc import Mapping
from typing import Any

from ....schemas.runs.axes import AxisSetting, number_kind
from ....schemas.runs.axis_kinds.kind import AxisError, Setter, refusal
from ..episode.run_results import Observer
from .rig import ModelRig


class Variation(Observer):
    """Values of a trial's axes in an environment.

    As an observer it checks that the values stay in effect: an environment that builds its model anew at `reset` would
    run every trial with the default values.

    Args:
        kinds: Kind of each axis by name; only axes whose values are numbers.
    """

    def __init__(self, kinds: Mapping[str, str]) -> None:
        self._kinds = kinds
        self._rig: ModelRig | None = None
        self._setters: dict[str, Setter] = {}
        self._changes: dict[str, Any] = {}

    def applied(self, environment: Any, settings: Mapping[str, AxisSetting]) -> Any:
        """Applies values to a new environment before its `reset`, and returns the environment.

        Args:
            environment: The environment.
            settings: Values by name of the axis; axes without a value stay as built.

        Raises:
            AxisError: An axis cannot be applied to it, whether it is named or not.
        """
        if self._kinds:
            self._bind(environment)
        self.set(settings)
        return environment

    def _bind(self, environment: Any) -> None:
        """Finds the parts of an environment that the axes change; raises `AxisError` if it does not have them."""
        self._setters.clear()
        name = kind = ""
        try:
            for name, kind in self._kinds.items():
                self._rig = self._rig if self._setters else ModelRig(environment)
                assert self._rig is not None
                self._setters[name] = number_kind(kind).bind(self._rig)
        except AxisError as error:
            raise AxisError(refusal(name, kind, error)) from None

    def set(self, settings: Mapping[str, AxisSetting]) -> None:
        """Applies the values of a trial before the environment's `reset`; axes without a value are set back.

        Args:
            settings: Values by name of the axis.
        """
        for name, set_value in self._setters.items():
            assert self._rig is not None
            self._rig.axis = name
            set_value(settings[name].value if name in settings else None)
        if self._rig is not None:
            self._changes = self._rig.changes()
        self.next_time_s = 0.0

    def watch(self, environment: Any, time_s: float) -> None:  # noqa: ARG002 - the rig has the environment
        """Checks once after `reset` that the values are still in effect.

        Raises:
            AxisError: A value is not in effect.
        """
        self._check()
        self.next_time_s = math.inf

    def last_look(self, environment: Any) -> None:  # noqa: ARG002 - as above
        """Checks at the end of the run that the values are still in effect.

        Raises:
            AxisError: A value is not in effect.
        """
        self._check()

    def _check(self) -> None:
        if self._rig is not None and (lost := self._rig.lost(self._changes)):
            names = ", ".join(f"{name} ({kind})" for name, kind in self._kinds.items())
            raise AxisError(f"trials.axes: {names} cannot be applied: {lost}, so that values of axes are lost")
