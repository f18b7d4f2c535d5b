"""Operations that steps of specifications can call: the API's operations, and those that only steps have."""

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from typing import Any

from ...schemas.specs.specification import CheckedStep
from ...schemas.wire.errors import ConfigurationError, InvalidParameterException, StorageError
from ...schemas.worlds.step_operations import (
    STEP_OPERATIONS,
    VariedWorld,
    VaryWorldsRequest,
    VaryWorldsResponse,
    WorldVariation,
)
from ..service.service import Service
from ..simulations.inputs.bundles import world_bundle
from .existing_resources import existing_application
from .registry import Operation, registry
from .world_templates import existing_template


@cache
def step_registry() -> Mapping[str, Operation]:
    """Returns all operations that steps of a specification may call, by name."""
    shape = STEP_OPERATIONS["VaryWorlds"]
    return {**registry(), shape.name: Operation(shape, _vary_worlds)}


def existing_resource(step: CheckedStep, request: Mapping[str, Any], service: Service) -> dict[str, Any] | None:
    """Returns the response of a step whose application or template is there already, as its `ifExists` says.

    Args:
        step: The step.
        request: Its request's members.
        service: The service, with its catalog and object store.

    Returns:
        `None` if the step has to create it, or creates something else.

    Raises:
        ServiceError: The name is taken by something else, or the request is refused.
    """
    if step.operation == "CreateWorldTemplate":
        return existing_template(step.if_exists, request, service)
    return existing_application(step, request, service)


def _vary_worlds(request: VaryWorldsRequest, service: Service) -> VaryWorldsResponse:
    """Handles the step operation `VaryWorlds`: makes and stores each variation of each world, and returns them.

    A variation may break guarantees. Existing ones are not made again.
    """
    made = [
        _varied(arn, variation, f"variations[{number}] of world {arn}", service)
        for arn in request.worlds
        for number, variation in enumerate(request.variations)
    ]
    return VaryWorldsResponse(worlds=[each.arn for each in made], variedWorlds=made)


def _varied(arn: str, wanted: WorldVariation, what: str, service: Service) -> VariedWorld:
    # MuJoCo and the generator take long to import.
    from ..worldforge.bundle.bundle import read_world
    from ..worldforge.generator import Move, Wanted
    from ..worldforge.proofs.guarantees import violations
    from ..worlds.keeping import keep_variation
    from ..worlds.reuse import find_by_origin

    resource = service.catalog.get(arn, kind="world")
    origin = _origin_of(arn, wanted)
    kept = find_by_origin(origin, service)  # by this step, before its answer was lost
    if kept is None:
        doors = {**dict.fromkeys(wanted.shut, 0.0), **wanted.open}
        moved = {piece: Move(*by) for piece, by in wanted.move.items()}
        changes = Wanted(doors, moved, wanted.remove, wanted.light, wanted.friction)
        try:
            bundle = world_bundle(resource, service)
        except StorageError as error:
            raise InvalidParameterException(f"{what}: {error}") from error
        try:
            kept = keep_variation(bundle, changes, arn, service, origin=origin)
        except (ConfigurationError, ValueError) as error:
            raise InvalidParameterException(f"{what}: {error}") from error
    world = read_world(world_bundle(kept, service))
    assert world.variation is not None
    assert world.checks is not None
    return VariedWorld(
        arn=kept.arn,
        world=arn,
        changes=[f"{each.what} {each.thing}: {each.after}" for each in world.variation.changes],
        brokenGuarantees=violations(world.checks),
    )


def _origin_of(arn: str, wanted: WorldVariation) -> str:
    """Returns a hash of a variation's inputs: the generator version, the other world and the changes."""
    from ..worldforge.generator import GENERATOR_VERSION

    made_of = [GENERATOR_VERSION, arn, wanted.to_wire()]
    return hashlib.sha256(json.dumps(made_of).encode()).hexdigest()
