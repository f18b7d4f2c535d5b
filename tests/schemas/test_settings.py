"""Settings from the environment: defaults, bounds, and what a mistake is answered with."""

import pytest

from prefect_robomaker.schemas.settings import Settings, misspelt_settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError


def test_defaults_leave_a_healthy_machine_alone() -> None:
    settings = Settings.from_environment({})

    assert (settings.job_memory_mb, settings.min_free_disk_mb, settings.nice) == (300, 200, 0)


@pytest.mark.parametrize(
    ("name", "value", "bounds"),
    [
        ("ROBOMAKER_NICE", "20", "0 to 19"),
        ("ROBOMAKER_NICE", "-1", "0 to 19"),
        ("ROBOMAKER_JOB_MEMORY_MB", "half", "0 to 9999999"),
        ("ROBOMAKER_MIN_FREE_DISK_MB", "10000000", "0 to 9999999"),
        ("ROBOMAKER_MAX_JOBS", "0", "1 to 9999"),
        ("ROBOMAKER_MAX_JOBS", "10000", "1 to 9999"),
    ],
)
def test_a_number_out_of_bounds_is_refused_with_them(name: str, value: str, bounds: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^{name} is '{value}'; it has to be a number from {bounds}$"):
        Settings.from_environment({name: value})


def test_zero_turns_memory_and_disk_off() -> None:
    settings = Settings.from_environment({"ROBOMAKER_JOB_MEMORY_MB": "0", "ROBOMAKER_MIN_FREE_DISK_MB": "0"})

    assert (settings.job_memory_mb, settings.min_free_disk_mb) == (0, 0)


def test_what_jobs_are_confined_to() -> None:
    settings = Settings.from_environment({"ROBOMAKER_SANDBOX": "require", "ROBOMAKER_SANDBOX_SHOW": "/data:/maps"})

    assert (settings.sandbox, settings.sandbox_network) == ("require", "full")
    assert [str(path) for path in settings.sandbox_show] == ["/data", "/maps"]
    with pytest.raises(ConfigurationError, match=r"^ROBOMAKER_SANDBOX .*auto.*require.*off"):
        Settings.from_environment({"ROBOMAKER_SANDBOX": "maybe"})
    with pytest.raises(ConfigurationError, match=r"^ROBOMAKER_SANDBOX_SHOW has 'maps'; it has to be an absolute path"):
        Settings.from_environment({"ROBOMAKER_SANDBOX_SHOW": "maps"})


def test_trusted_proxies_are_addresses_or_networks() -> None:
    settings = Settings.from_environment({"ROBOMAKER_TRUSTED_PROXIES": "10.0.0.7, 10.1.0.0/16"})

    assert [str(each) for each in settings.trusted_proxies] == ["10.0.0.7/32", "10.1.0.0/16"]
    with pytest.raises(
        ConfigurationError, match=r"^ROBOMAKER_TRUSTED_PROXIES has 'proxy'; it has to be an address such"
    ):
        Settings.from_environment({"ROBOMAKER_TRUSTED_PROXIES": "proxy"})


def test_variables_that_resemble_a_setting_are_found() -> None:
    misspelt = {
        "ROBOMAKER_MAX_JOB": "ROBOMAKER_MAX_JOBS",
        "ROBOMAKER_OBJECTSTORE": "ROBOMAKER_OBJECT_STORE",
        "ROBOMAKER_REGON": "ROBOMAKER_REGION",
    }
    fine = ("ROBOMAKER_MAX_JOBS", "ROBOMAKER_ROBOT", "ROBOMAKER_SEED", "ROBOMAKER_ROS", "ROBOMAKER_JOB_ROOT", "REGON")

    assert misspelt_settings(dict.fromkeys([*misspelt, *fine], "1")) == misspelt
