"""Schemas of forms: what is optional is shown at once, and the default of a choice is chosen."""

from prefect_robomaker.deployments.deploying.registration import form_schema
from prefect_robomaker.flows.operations import CreateRobot, CreateSimulationJob, StartSimulationJobBatch


def test_optional_choices_are_shown_at_once_with_their_default_chosen() -> None:
    schema = form_schema(CreateSimulationJob)
    video = schema["properties"]["video"]

    assert (video["type"], video["enum"], video["default"]) == ("string", ["none", "on-failure", "always"], "none")
    assert video["description"].startswith("Extension: whether a video is made")
    assert schema["properties"]["failureBehavior"]["default"] == "Fail"
    assert "required" not in schema, "what the service requires has a default"
    assert schema["properties"]["maxJobDurationInSeconds"]["default"] == 3600


def test_optional_numbers_texts_and_lists_are_shown_at_once_and_are_empty() -> None:
    properties = form_schema(CreateSimulationJob)["properties"]

    shown = {name: properties[name].get("type") for name in ("seed", "clientRequestToken", "robotApplications")}
    assert shown == {"seed": "integer", "clientRequestToken": "string", "robotApplications": "array"}
    assert not [name for name in shown if "default" in properties[name]]
    assert properties["compute"]["anyOf"][-1] == {"type": "null"}


def test_what_is_within_is_shown_so_too_by_the_names_of_members() -> None:
    definitions = form_schema(StartSimulationJobBatch)["definitions"]
    job, source = definitions["SimulationJobRequest"]["properties"], definitions["DataSourceConfig"]["properties"]

    assert (job["video"]["default"], job["seed"]["type"], source["type"]["default"]) == ("none", "integer", "File")
    assert job["useDefaultApplications"]["anyOf"][-1] == {"type": "null"}
    assert job["iamRole"]["title"] == "iamRole"


def test_what_is_required_has_no_default() -> None:
    architecture = form_schema(CreateRobot)["properties"]["architecture"]

    assert architecture["enum"] == ["X86_64", "ARM64", "ARMHF"]
    assert "default" not in architecture
