import pytest

from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.checking.impossible_goals import check_world_counts
from prefect_robomaker.schemas.wire.errors import SpecError

SPEC = """
version: 1
name: many
steps:
  some:
    operation: CreateWorldGenerationJob
    input: {template: "arn:t", worldCount: {floorplanCount: 2, interiorCountPerFloorplan: 25}}
  more:
    operation: CreateWorldGenerationJob
    input:
      template: "arn:t"
      worldCount: {floorplanCount: 17, interiorCountPerFloorplan: 3}
"""


def test_a_job_that_would_fail_for_its_number_of_worlds_is_told_with_its_place() -> None:
    with pytest.raises(SpecError) as refused:
        check_world_counts(load_spec(SPEC, "s.yaml"), 50)

    (problem,) = refused.value.problems
    assert str(problem).startswith("s.yaml:12:20: steps.more.input.worldCount: 17 floor plans with 3 interiors each")
    assert "51 worlds; a job may make at most 50" in problem.message


@pytest.mark.parametrize(
    ("text", "most"),
    [
        (SPEC, 51),
        (SPEC.replace("floorplanCount: 17", 'floorplanCount: "${{ some.worldCount.floorplanCount }}"'), 50),
    ],
)
def test_counts_within_the_limit_or_not_known_yet_pass(text: str, most: int) -> None:
    check_world_counts(load_spec(text, "s.yaml"), most)
