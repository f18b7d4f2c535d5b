"""Generates the API model of this service in the form that boto3 and the AWS CLI read.

`python -m prefect_robomaker.deployments.service_model.model` writes the files of `MODEL_FOLDER` from the
schemas. The service's name, API version and protocol are unchanged, so that code written for it runs on.
"""

import json
from typing import Any

from ...schemas.operations.registry import OPERATIONS
from ...schemas.wire.operation_shape import OperationShape
from .installation import ENDPOINT_RULES, FULL_NAME, MODEL_FOLDER, PAGINATORS, SERVICE, WAITERS
from .shapes import Definition, Shapes, as_html
from .waiters import waiters_model

METADATA: dict[str, Any] = {
    "apiVersion": "2018-06-29",
    "auth": ["aws.auth#sigv4"],
    "endpointPrefix": "robomaker",
    "protocol": "rest-json",
    "protocols": ["rest-json"],
    "serviceAbbreviation": "RoboMaker",
    "serviceFullName": FULL_NAME,
    "serviceId": "RoboMaker",
    "signatureVersion": "v4",
    "signingName": "robomaker",
    "uid": "robomaker-2018-06-29",
}
DOCUMENTATION = "Generate worlds, simulate robots in them, learn what broke: RoboMaker's interface, served by Prefect."
DEPRECATED = "The service gave up deploying to robots before it ended; new code does without."
FILLED_IN = frozenset(
    {
        "CreateDeploymentJob",
        "CreateSimulationJob",
        "CreateWorldExportJob",
        "CreateWorldGenerationJob",
        "StartSimulationJobBatch",
        "SyncDeploymentJob",
    }
)
"""Operations whose `clientRequestToken` SDKs generate if the caller gives none."""
NO_ENDPOINT = (
    "RoboMaker has no endpoint of its own: start `robomaker serve` and give its URL as endpoint_url, "
    "--endpoint-url or AWS_ENDPOINT_URL_ROBOMAKER"
)


def service_model() -> dict[str, Any]:
    """Generates `service-2.json`, the API model for AWS SDKs.

    Raises:
        ValueError: Two different types claim one shape's name, or a type has none.
    """
    shapes = Shapes()
    operations = {name: _operation(OPERATIONS[name], shapes) for name in sorted(OPERATIONS)}
    return {
        "version": "2.0",
        "metadata": METADATA,
        "operations": operations,
        "shapes": dict(sorted(shapes.definitions.items())),
        "documentation": as_html(DOCUMENTATION),
    }


def _operation(operation: OperationShape, shapes: Shapes) -> Definition:
    request = shapes.add_structure(operation.request)
    response = shapes.add_structure(operation.response)
    members = shapes.definitions[request]["members"]
    for member, location in operation.locations.items():
        members[member] |= {"location": location, "locationName": member}
    if operation.name in FILLED_IN:
        members["clientRequestToken"]["idempotencyToken"] = True
    definition: Definition = {
        "name": operation.name,
        "http": {"method": operation.method, "requestUri": operation.path},
        "input": {"shape": request},
        "output": {"shape": response},
        "errors": [{"shape": shapes.add_error(error)} for error in operation.errors],
        "documentation": as_html(operation.description),
    }
    if operation.deprecated:
        for each in (definition, shapes.definitions[request], shapes.definitions[response]):
            each |= {"deprecated": True, "deprecatedMessage": DEPRECATED}
    return definition


def paginators_model() -> dict[str, Any]:
    """Generates `paginators-1.json`, which tells AWS SDKs how to page through lists."""
    return {
        "pagination": {
            name: {
                "input_token": "nextToken",
                "output_token": "nextToken",
                "limit_key": "maxResults",
                "result_key": operation.result_key,
            }
            for name, operation in sorted(OPERATIONS.items())
            if operation.result_key
        }
    }


def endpoint_rules() -> dict[str, Any]:
    """Generates `endpoint-rule-set-1.json`, by which AWS SDKs use only the given endpoint.

    Without it SDKs would guess an address at AWS and send signed requests there.
    """
    given = {"ref": "Endpoint"}
    return {
        "version": "1.0",
        "parameters": {
            "Endpoint": {
                "builtIn": "SDK::Endpoint",
                "required": False,
                "type": "String",
                "documentation": "Where RoboMaker is served.",
            },
            "Region": {
                "builtIn": "AWS::Region",
                "required": False,
                "type": "String",
                "documentation": "Region that requests are signed for.",
            },
        },
        "rules": [
            {
                "conditions": [{"fn": "isSet", "argv": [given]}],
                "endpoint": {"url": given, "properties": {}, "headers": {}},
                "type": "endpoint",
            },
            {"conditions": [], "error": NO_ENDPOINT, "type": "error"},
        ],
    }


def model_files() -> dict[str, str]:
    """Returns all files of the API model for AWS SDKs, as committed."""
    models = {
        SERVICE: service_model(),
        PAGINATORS: paginators_model(),
        WAITERS: waiters_model(),
        ENDPOINT_RULES: endpoint_rules(),
    }
    return {name: json.dumps(model, indent=1, ensure_ascii=False) + "\n" for name, model in models.items()}


if __name__ == "__main__":
    MODEL_FOLDER.mkdir(parents=True, exist_ok=True)
    for file_name, text in model_files().items():
        (MODEL_FOLDER / file_name).write_text(text)
