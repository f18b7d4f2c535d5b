"""Endpoints of AWS services for SDKs in jobs: the services of this deployment, and a refusal of all others.

SDKs since 2023 read environment variables. Older ones read a list of endpoints in a folder of `AWS_DATA_PATH`, in which
a hostname may be followed by a path.
"""

import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from ....schemas.roles import find_role
from ....schemas.runs.variables import CALL_AWS, ENDPOINT_VARIABLE, REFUSED
from ....schemas.settings import Settings
from ...service.service import Service
from .folders import AWS, Sandbox

ALL_VARIABLE = "AWS_ENDPOINT_URL"
"""Variable with the endpoint of all services that no other variable names."""
DATA_VARIABLE = "AWS_DATA_PATH"
MODELS, NO_AWS = "models", "no-aws"
"""Folders with endpoint lists: one with AWS's endpoints for the services that are not provided here, and one without
AWS endpoints.
"""

_NAMES = {"robomaker": ENDPOINT_VARIABLE, "s3": "AWS_ENDPOINT_URL_S3", "sts": "AWS_ENDPOINT_URL_STS"}
_MODEL = Path("robomaker")
# Port 1 belongs to a protocol that no system has had for decades: connections are refused at once.
_NOBODY = f"http://127.0.0.1:1/jobs-call-no-AWS-unless-{CALL_AWS}-is-1"
# Services of AWS that have one address for all regions.
_GLOBAL = {
    "budgets": "budgets.amazonaws.com",
    "ce": "ce.us-east-1.amazonaws.com",
    "cloudfront": "cloudfront.amazonaws.com",
    "iam": "iam.amazonaws.com",
    "organizations": "organizations.us-east-1.amazonaws.com",
    "route53": "route53.amazonaws.com",
    "waf": "waf.amazonaws.com",
}
_OWN_KEYS = (
    *("AWS_ACCESS_KEY_ID", "AWS_PROFILE", "AWS_CONFIG_FILE", "AWS_SHARED_CREDENTIALS_FILE"),
    *("AWS_WEB_IDENTITY_TOKEN_FILE", "AWS_CONTAINER_CREDENTIALS_FULL_URI", "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI"),
)
_USUAL_PROFILE = ("AWS_PROFILE", "default")


def store_server(settings: Settings) -> str | None:
    """Returns the URL of the S3 server of the object store; `None` if the store is AWS or a folder."""
    return settings.object_store.rstrip("/") if "://" in settings.object_store else None


def brings_keys(variables: Mapping[str, str]) -> bool:
    """Returns whether a launch configuration's variables contain AWS credentials."""
    # The profile of this name is what a job has anyway: it is in the file that is written for the job's role.
    return any(variables.get(name) and (name, variables[name]) != _USUAL_PROFILE for name in _OWN_KEYS)


def endpoint_variables(
    variables: Mapping[str, str],
    role: str | None,
    sandbox: Sandbox,
    service: Service,
    environ: Mapping[str, str],
    *,
    has_role_keys: bool,
) -> dict[str, str]:
    """Makes the variables by which AWS SDKs in a job call this service and its object store instead of AWS.

    Writes the files that the variables name. Returns no variables if there is neither a server to call nor AWS to
    refuse.

    Args:
        variables: Environment variables of the run so far.
        role: ARN of the role that the job's request names.
        sandbox: Folders of the run.
        service: The service, with its catalog and object store.
        environ: Environment variables of this process.
        has_role_keys: Whether the role has credentials.
    """
    store = store_server(service.settings)
    served = {"robomaker": variables.get(ENDPOINT_VARIABLE), "s3": store}
    if store and has_role_keys and service.roles is not None and role is not None:
        meant = find_role(service.roles.roles, role)
        served["sts"] = store if meant is not None and meant.assume_role else None
    found = {name: url for name, url in served.items() if url}
    # Keys of a role are the S3 server's, or AWS's; others are the placeholders that clients of the service are given.
    has_keys_of_ours = store is not None if has_role_keys else "AWS_ACCESS_KEY_ID" in variables
    refuses = has_keys_of_ours and not service.settings.jobs_call_aws
    if not found and not refuses:
        return {}
    folder, region = sandbox.place(AWS), service.settings.region
    _write_list(folder / MODELS, found, region, None)
    _copy_model(variables, folder / MODELS)
    paths = [str(folder / MODELS), *filter(None, [variables.get(DATA_VARIABLE)])]
    made = {_NAMES[name]: url for name, url in found.items()}
    if refuses:
        endpoint = environ.get(ENDPOINT_VARIABLE)
        made[ALL_VARIABLE] = f"{endpoint.rstrip('/')}{REFUSED}" if endpoint else _NOBODY
        _write_list(folder / NO_AWS, found, region, made[ALL_VARIABLE])
        paths.insert(0, str(folder / NO_AWS))
    # Else SDKs before 2024 have an address of STS that is on no list.
    return {**made, DATA_VARIABLE: os.pathsep.join(paths), "AWS_STS_REGIONAL_ENDPOINTS": "regional"}


def without_refusal(variables: Mapping[str, str]) -> dict[str, str]:
    """Returns variables without those that refuse AWS, for programs with AWS credentials of their own."""
    kept = {name: value for name, value in variables.items() if name != ALL_VARIABLE}
    if ALL_VARIABLE in variables and (paths := variables.get(DATA_VARIABLE)):
        kept[DATA_VARIABLE] = os.pathsep.join(
            path for path in paths.split(os.pathsep) if not path.endswith(f"{AWS}/{NO_AWS}")
        )
    return kept


def container_data_path(variables: Mapping[str, str]) -> dict[str, str]:
    """Returns the variable by which AWS SDKs in a container find the service's model files; empty if a job has none."""
    paths = variables.get(DATA_VARIABLE, "").split(os.pathsep)
    found = [f"{AWS}/{name}" for name in (NO_AWS, MODELS) if any(path.endswith(f"{AWS}/{name}") for path in paths)]
    return {DATA_VARIABLE: os.pathsep.join(found)} if found else {}


def _copy_model(variables: Mapping[str, str], folder: Path) -> None:
    """Copies the service's model next to the endpoint lists, as containers do not have the job worker's folders.

    Does nothing if the variables name no model.
    """
    for place in variables.get(DATA_VARIABLE, "").split(os.pathsep):
        if place and (model := place / _MODEL).is_dir():
            shutil.copytree(model, folder / _MODEL, dirs_exist_ok=True)
            return


def _write_list(folder: Path, served: Mapping[str, str], region: str, others: str | None) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    folder.parent.parent.chmod(0o700)  # the service's address holds the job's key
    text = json.dumps(_list(served, region, others), indent=1)
    (folder / "endpoints.json").write_text(text, encoding="utf-8")


def _list(served: Mapping[str, str], region: str, others: str | None) -> dict[str, Any]:
    """Returns an endpoint list that replaces botocore's own.

    Args:
        served: Endpoint URLs of the services that are provided here, by their names in botocore.
        region: Region of the service.
        others: Endpoint of all other services; `None`: that of AWS.
    """
    regions = {name: {"description": name} for name in dict.fromkeys((region, "us-east-1"))}
    services: dict[str, Any] = {}
    for name, host in {} if others else _GLOBAL.items():
        place = {**_place(f"https://{host}"), "credentialScope": {"region": "us-east-1"}}
        services[name] = {
            "isRegionalized": False, "partitionEndpoint": "aws-global", "endpoints": {"aws-global": place}
        }  # fmt: skip
    usual = {"hostname": "{service}.{region}.{dnsSuffix}", "protocols": ["https"]}
    here = {name: _place(url) for name, url in served.items()}
    for name, place in {"s3": _place(others) if others else usual, **here}.items():
        signed = {**place, "signatureVersions": ["s3v4" if name == "s3" else "v4"]}
        services[name] = {"defaults": signed, "endpoints": dict.fromkeys(regions, signed)}
    # SDKs look for S3 in us-east-1 under this name.
    is_at_aws = not others and "s3" not in here
    of_all = {**services["s3"]["defaults"], "credentialScope": {"region": "us-east-1" if is_at_aws else region}}
    services["s3"]["endpoints"]["aws-global"] = {**of_all, "hostname": "s3.amazonaws.com"} if is_at_aws else of_all
    services["s3"] |= {"isRegionalized": True, "partitionEndpoint": "aws-global"}
    partition = {
        "partition": "aws",
        "partitionName": "what is served here",
        "dnsSuffix": "amazonaws.com",
        "regionRegex": r"^[a-z0-9-]+$",
        "defaults": {**(_place(others) if others else usual), "signatureVersions": ["v4"]},
        "regions": regions,
        "services": services,
    }
    return {"version": 3, "partitions": [partition]}


def _place(url: str) -> dict[str, Any]:
    parts = urlsplit(url.rstrip("/"))
    return {"hostname": f"{parts.netloc}{parts.path}", "protocols": [parts.scheme]}
