"""Job templates of work pools."""

import pytest

from prefect_robomaker.deployments.deploying.job_variables import TYPES, pool_template
from prefect_robomaker.schemas.wire.errors import ConfigurationError


@pytest.mark.parametrize("kind", TYPES)
def test_runs_of_a_pool_send_heartbeats_every_half_minute(kind: str, prefect_server: str) -> None:
    image = None if kind == "process" else "lab/robots:1"

    template = pool_template(kind, image=image, environment={"ROBOMAKER_BUCKET": "runs"})

    properties = template["variables"]["properties"]
    assert template["job_configuration"]["env"] == "{{ env }}"
    assert properties["env"]["default"]["PREFECT_FLOWS_HEARTBEAT_FREQUENCY"] == "30"
    assert properties["env"]["default"]["ROBOMAKER_BUCKET"] == "runs"
    assert properties.get("image", {}).get("default") == image


def test_a_template_is_made_anew_each_time() -> None:
    pool_template("process", environment={"ONLY": "once"})

    assert "ONLY" not in pool_template("process")["variables"]["properties"]["env"]["default"]


@pytest.mark.parametrize(("kind", "image"), [("docker", None), ("kubernetes", None), ("process", "lab/robots:1")])
def test_an_image_is_for_containers(kind: str, image: str | None) -> None:
    with pytest.raises(ConfigurationError, match=r"^--image is "):
        pool_template(kind, image=image)
