"""Notes on known failures that can mark no failure: a requirement that no job has, or a day that is over."""

import pytest
from helpers.cartpole_spec import poles

from prefect_robomaker.schemas.specs.check import load_spec

SPEC = """\
version: 1
name: night
known: [{{match: {{requirement: {requirement}}}, owner: anna, until: {until}}}]
steps:
  drive:
    operation: CreateSimulationJob
    input:
      maxJobDurationInSeconds: 60
      iamRole: arn:aws:iam::000000000000:role/test
      robotApplications: [{{application: scout, launchConfig: {{}}}}]
      simulationApplications: [{{application: {environment}, launchConfig: {{}}, worldConfigs: [{{world: WORLD}}]}}]
      requirements:
        - {{name: polite, kind: time_limit, limit_s: 9}}
        - {{name: to-bed, kind: time_limit, limit_s: 9}}
"""
SPEC = SPEC.replace("WORLD", "'arn:aws:robomaker:us-east-1:000000000000:world/import-1/world-1'")
LATER = "2999-01-01"


@pytest.mark.parametrize(
    ("requirement", "until", "environment", "notes"),
    [
        (
            "gentle",
            LATER,
            "indoor-navigation",
            [
                "x.yaml:3:31: known[0].match.requirement: no job asks for a requirement `gentle`; there are "
                "rooms_visited, no_hard_collision, upright, polite, to-bed"
            ],
        ),
        (
            "polite",
            "2026-01-01",
            "indoor-navigation",
            [
                "x.yaml:3:60: known[0].until: its last day was 2026-01-01: the failure counts again; write a later "
                "day, or remove the entry"
            ],
        ),
        ("pol*", LATER, "indoor-navigation", []),
        ("upright", LATER, "indoor-navigation", []),
        ("trials", LATER, "indoor-navigation", []),
        ("above_floor", LATER, "indoor-navigation", []),
        ("gentle", LATER, "yard", []),
    ],
    ids=lambda each: each if isinstance(each, str) else "",
)
def test_what_can_mark_no_failure_is_noted(requirement: str, until: str, environment: str, notes: list[str]) -> None:
    text = SPEC.format(requirement=requirement, until=until, environment=environment)
    found = load_spec(text, "x.yaml").notes
    assert [str(each) for each in found if each.path.startswith("known")] == notes


@pytest.mark.parametrize("member", ["seed: 1", "requirements: [{name: quick, kind: time_limit, limit_s: 0.1}]"])
def test_an_environment_of_ones_own_may_have_any_requirement(member: str) -> None:
    entry = f"known: [{{match: {{requirement: gentle}}, owner: anna, until: {LATER}}}]\n"
    assert not [each for each in load_spec(entry + poles(member), "x.yaml").notes if each.path.startswith("known")]
