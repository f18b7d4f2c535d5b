"""Schemas of forms: choices are choices, whether optional or not."""

from prefect_robomaker.deployments.deploying.forms import form_schema
from prefect_robomaker.flows.robots import CreateRobot
from prefect_robomaker.flows.simulation_jobs import CreateSimulationJob


def test_optional_choices_are_shown_at_once_and_sent_only_when_made() -> None:
    schema = form_schema(CreateSimulationJob)
    video = schema["properties"]["video"]

    assert (video["type"], video["enum"]) == ("string", ["none", "on-failure", "always"])
    assert video["description"].startswith("Extension: whether a video is made")
    assert "default" not in video
    assert "video" not in schema["required"]


def test_what_is_no_choice_stays() -> None:
    properties = form_schema(CreateSimulationJob)["properties"]

    assert properties["seed"]["anyOf"][-1] == {"type": "null"}
    assert form_schema(CreateRobot)["properties"]["architecture"]["enum"] == ["X86_64", "ARM64", "ARMHF"]
