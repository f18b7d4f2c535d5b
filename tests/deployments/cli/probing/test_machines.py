"""The machines that a forecast is for."""

import pytest

from prefect_robomaker.deployments.cli.probes import Machines
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError


@pytest.mark.parametrize(
    ("machines", "said"),
    [
        (Machines(0), "--machines is 0; a number from 1 would be right"),
        (Machines(2), "--machines is 2, but the backend is local"),
        (Machines(1, -0.5), "--price-per-hour is -0.5; a price from 0 would be right"),
        (Machines(1, float("nan")), "--price-per-hour is nan"),
        (Machines(1, float("inf")), "--price-per-hour is inf"),
    ],
)
def test_what_cannot_be_is_refused(settings: Settings, machines: Machines, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        machines.check(settings)


def test_a_backend_may_have_any_number_of_machines(settings: Settings) -> None:
    Machines(20, 0.0).check(settings.model_copy(update={"backend": "by-hand"}))
    Machines(1).check(settings)
