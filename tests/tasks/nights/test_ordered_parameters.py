"""Values of parameters in the order of a run: another process that finishes the run has the same ones."""

from pathlib import Path

from prefect_robomaker.schemas.reports.live_comparison import Against
from prefect_robomaker.schemas.reports.run_record import Order
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.specification import with_seed
from prefect_robomaker.schemas.specs.yaml_nodes import plain
from prefect_robomaker.tasks.nights.ending import RunFacts
from prefect_robomaker.tasks.nights.open_runs import ORDER
from prefect_robomaker.tasks.nights.run_orders import keep_order, ordered_run, ordered_spec
from prefect_robomaker.tasks.nights.wanted_runs import WantedRun
from prefect_robomaker.tasks.service.service import Service

SPEC = """\
version: 1
name: flats
parameters:
  worlds: {type: integer, default: 4}
  arm: {enum: [a, b]}
steps:
  worlds:
    operation: CreateWorldGenerationJob
    input:
      template: arn:aws:robomaker:us-east-1:000000000000:world-template/flat
      worldCount: {floorplanCount: "${{ parameters.worlds }}", interiorCountPerFloorplan: 1}
      tags: {arm: "${{ parameters.arm }}"}
"""


def test_the_kept_order_makes_the_specification_that_was_ordered(service: Service) -> None:
    spec = with_seed(load_spec(SPEC, "flats.yaml", {"worlds": 20, "arm": "b"}), 7)
    folder = service.folder("runs", "flats-1")
    wanted = WantedRun(
        spec,
        "flats.yaml",
        ["robomaker", "run", "flats.yaml"],
        against=Against(run_id="flats-0", alpha=0.01, margin=0.1),
    )
    facts = RunFacts(wanted=wanted, run_id="flats-1", started_at=service.clock(), source=None, folder=folder)

    begun = keep_order(
        facts,
        service,
        None,
        flow_run=None,
        deployment=None,
        outlasting=lambda call: call(),
        listener=lambda _event: None,
    )
    assert begun is not None
    kept = Order.model_validate_json((folder / ORDER).read_bytes())
    assert ordered_run(begun).against == kept.against == wanted.against
    begun.end()

    again = ordered_spec(kept)
    assert again.parameters == {"worlds": 20, "arm": "b"}
    assert plain(again.steps["worlds"].input) == plain(spec.steps["worlds"].input)


def test_an_order_keeps_defaults_also_where_a_later_release_has_another(tmp_path: Path) -> None:
    spec = load_spec(SPEC, "flats.yaml", {"arm": "a"})
    order = Order(
        run_id="flats-1",
        text=SPEC.replace("default: 4", "default: 9"),
        filename="flats.yaml",
        spec_path="flats.yaml",
        command=["true"],
        parameters=dict(spec.parameters),
    )
    assert ordered_spec(order).parameters == {"worlds": 4, "arm": "a"}
