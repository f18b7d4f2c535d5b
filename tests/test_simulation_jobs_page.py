"""The page about simulation jobs: what it lists is all there is, and its example is valid."""

import re
from typing import get_args

import pytest
import yaml
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.operations.simulation_jobs import SimulationJobErrorCode, SimulationJobStatus
from prefect_robomaker.schemas.wire.job_configs import SimulationApplicationConfig

PAGE = (REPOSITORY / "docs" / "simulation-jobs.md").read_text()


def choices(shape: object) -> tuple[str, ...]:
    """The values of an annotated literal."""
    return get_args(get_args(shape)[0])


@pytest.mark.parametrize("name", [*choices(SimulationJobErrorCode), *choices(SimulationJobStatus)])
def test_every_code_and_status_is_explained(name: str) -> None:
    assert re.search(rf"`{name}`", PAGE)


def test_the_example_of_uploads_is_valid() -> None:
    [block] = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    example = yaml.safe_load(block)

    for config in example["simulationApplications"]:
        assert len(SimulationApplicationConfig.model_validate(config).uploadConfigurations or []) == 2
