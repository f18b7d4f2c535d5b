"""Settings of fleets are read and checked with all others."""

import pytest

from prefect_robomaker.schemas.fleet.settings import FleetSettings
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError


def test_variables_and_defaults() -> None:
    read = FleetSettings.of(Settings.from_environment({"ROBOMAKER_ROBOT_POLL_S": "7"}))

    assert (read.robot_poll_s, read.robot_folder, read.robots_url) == (7, "/opt/robomaker", None)


@pytest.mark.parametrize("seconds", ["0", "86400"])
def test_a_number_out_of_bounds_is_refused_with_them(seconds: str) -> None:
    refused = f"^ROBOMAKER_ROBOT_POLL_S is '{seconds}'; it has to be a number from 1 to 86399$"
    with pytest.raises(ConfigurationError, match=refused):
        Settings.from_environment({"ROBOMAKER_ROBOT_POLL_S": seconds})


@pytest.mark.parametrize(("name", "value"), [("ROBOTS_URL", "robots.example.com"), ("ROBOT_FOLDER", "robomaker")])
def test_a_text_that_is_none_of_its_kind_is_refused_by_name(name: str, value: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^ROBOMAKER_{name} "):
        Settings.from_environment({f"ROBOMAKER_{name}": value})
