"""The machines that a forecast is for, checked before anything is started."""

import math
from dataclasses import dataclass

from ....schemas.settings import Settings
from ....schemas.wire.errors import ConfigurationError


@dataclass(frozen=True)
class Machines:
    """The machines that a forecast is for."""

    count: int = 1
    price_per_hour: float | None = None
    """Price of one machine per hour, in any currency; None: no cost is forecast."""

    def check(self, settings: Settings) -> None:
        """Refuses what cannot be.

        Args:
            settings: those of the probe, with its backend.

        Raises:
            ConfigurationError: a number is too small, or jobs run on this machine alone.
        """
        if self.count < 1:
            raise ConfigurationError(f"--machines is {self.count}; a number from 1 would be right")
        if self.count > 1 and settings.backend == "local":
            raise ConfigurationError(
                f"--machines is {self.count}, but the backend is local, which is this machine alone; leave it out, or "
                "name a --backend"
            )
        if self.price_per_hour is not None and not 0 <= self.price_per_hour < math.inf:
            raise ConfigurationError(f"--price-per-hour is {self.price_per_hour:g}; a price from 0 would be right")
