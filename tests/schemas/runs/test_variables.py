import math
from pathlib import Path

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.variables import number_in, variables_of


def test_the_simulation_application_goes_before_the_robots_and_the_services_variables() -> None:
    def application(role, **variables: str) -> ApplicationPlan:
        return ApplicationPlan(role=role, name=role, attribute="a.b", environment_variables=variables)

    plan = RunPlan(
        job_id="sim-1", job_arn="arn:sim-1", run_id="run-1", seed=1, max_duration_s=1.0,
        work_dir=Path("work"), output_dir=Path("out"), environment={"A": "service", "B": "service", "C": "service"},
        robot_application=application("robot", B="robot", C="robot"),
        simulation_application=application("simulation", C="simulation"),
    )  # fmt: skip
    assert variables_of(plan) == {"A": "service", "B": "robot", "C": "simulation"}


def test_what_is_no_number_is_within_no_bounds() -> None:
    assert number_in("2.5") == 2.5
    assert math.isnan(number_in("five"))
    assert not number_in("five") > 0
    assert not number_in("five") <= 0
