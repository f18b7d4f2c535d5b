"""What there is to deploy: names, texts, and what a specification keeps and needs."""

import re

import pytest
from botocore import xform_name
from helpers.paths import REPOSITORY

from prefect_robomaker.deployments.deploying.deployables import (
    Deployable,
    deployment_name,
    needs_of,
    operation_deployables,
    spec_deployable,
)
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.operations.registry import registry

EXAMPLES = REPOSITORY / "deployments" / "specs" / "examples"
TEMPLATE = "{operation: CreateWorldTemplate, input: {name: flat, templateBody: '{}'}}"


def spec(name: str = "tiny", **extra: str) -> str:
    head = "".join(f"{key}: {value}\n" for key, value in {"name": name, **extra}.items())
    return f"version: 1\n{head}steps:\n  flat: {TEMPLATE}\n"


def test_operations_are_called_as_the_aws_cli_calls_them() -> None:
    assert {name: deployment_name(name) for name in registry()} == {name: xform_name(name, "-") for name in registry()}


def test_every_flow_of_an_operation_is_deployed_once_under_a_name_of_its_own() -> None:
    found = operation_deployables()
    performed = {entry.perform_name for entry in registry().values() if entry.run_job}

    assert {each.flow for each in found} == {*registry(), *performed}
    assert len({each.name for each in found}) == len(found) == 62
    assert all(each.description.endswith(".") and each.tags[0] == "robomaker" for each in found)
    assert not any(":" in each.entrypoint for each in found), "a colon would be a file, which workers copy a folder for"


def test_a_specification_is_kept_as_it_is_written() -> None:
    text = spec(description="Looks at flats.")

    made = spec_deployable(load_spec(text, "night/tiny.yaml"), origin="night/tiny.yaml", tags=["lab", "robomaker"])

    assert made.full_name == "RunPipeline/tiny"
    assert made.parameters == {"text": text, "origin": "night/tiny.yaml"}
    assert made.tags == ("robomaker", "specification", "lab")
    assert made.description == "Looks at flats.\n\n1. `flat`: CreateWorldTemplate"
    assert re.fullmatch("[0-9a-f]{12}", made.version or "")


def test_the_version_changes_with_the_text() -> None:
    def version(text: str) -> str | None:
        return spec_deployable(load_spec(text, "x"), origin="x").version

    assert version(spec()) == version(spec())
    assert version(spec()) != version(spec() + "# more\n")


def test_a_name_may_be_chosen() -> None:
    made: Deployable = spec_deployable(load_spec(spec(), "x"), origin="x", name="other")

    assert made.name == "other"


def test_a_text_that_prefect_would_not_take_is_refused() -> None:
    text = spec() + "# " + "x" * 400_000

    with pytest.raises(ConfigurationError, match=r"long\.yaml has 400\d{3} bytes; a deployment keeps at most 400000"):
        spec_deployable(load_spec(text, "long.yaml"), origin="long.yaml")


def test_a_specification_needs_archives_packages_and_images() -> None:
    found = needs_of(load_spec((EXAMPLES / "five_ways" / "five_ways.yaml").read_text(), "five_ways.yaml"))

    assert [need.uri for need in found] == [
        "s3://robomaker/applications/cartpole.tar.gz",
        "python://my_cartpole.agent",
        "s3://robomaker/applications/balancer.tar.gz",
    ]
    assert found[1].sentence == "the Python package my_cartpole.agent, installed where jobs run (step installed)"
    (image,) = [
        need
        for need in needs_of(load_spec((EXAMPLES / "five_ways" / "container.yaml").read_text(), "container.yaml"))
        if "://" not in need.uri
    ]
    assert image.sentence.startswith("the container image cartpole-balancer")
