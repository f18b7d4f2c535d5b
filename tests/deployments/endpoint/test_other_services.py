"""Services of AWS that are not served here are refused in their own protocols, so that SDKs say why."""

import urllib.error
import urllib.request
from typing import Any

import botocore.session
import pytest
from botocore.config import Config
from botocore.exceptions import ClientError
from helpers.endpoint_here import ServeHere

SENTENCE = "set ROBOMAKER_JOBS_CALL_AWS=1 where jobs are performed"
CALLS = [
    ("kinesis", "list_streams", {}),  # JSON
    ("lambda", "list_functions", {}),  # REST with JSON
    ("iam", "list_users", {}),  # forms, answered in XML
    ("s3", "put_object", {"Bucket": "any-bucket", "Key": "a/b", "Body": b"x"}),  # REST with XML
    ("s3", "put_object", {"Bucket": "any-bucket", "Key": "a/b", "Body": b"x" * 11_000_000}),  # more than is read
    pytest.param("ec2", "describe_instances", {}, marks=pytest.mark.deep),  # XML of its own
    pytest.param("route53", "list_hosted_zones", {}, marks=pytest.mark.deep),
]


@pytest.mark.parametrize(("name", "operation", "members"), CALLS)
def test_an_sdk_tells_the_sentence(
    name: str,
    operation: str,
    members: dict[str, object],
    serve_here: ServeHere,
) -> None:
    keys: Any = {"aws_access_key_id": "local", "aws_secret_access_key": "local", "region_name": "us-east-1"}
    quick = Config(retries={"max_attempts": 0})
    with serve_here() as served:
        client = botocore.session.Session().create_client(name, endpoint_url=f"{served.url}/aws", config=quick, **keys)
        with pytest.raises(ClientError) as caught:
            getattr(client, operation)(**members)

    response: Any = caught.value.response
    error = response["Error"]
    assert SENTENCE in error["Message"]
    assert error["Code"] in ("AccessDenied", "AccessDeniedException", "UnauthorizedOperation")
    assert response["ResponseMetadata"]["HTTPStatusCode"] == 403
    assert ("ROBOMAKER_OBJECT_STORE" in error["Message"]) == (name == "s3")


def test_other_paths_are_the_services_own(serve_here: ServeHere) -> None:
    with serve_here() as served:
        for path, status in (("/aws", 403), ("/aws/", 403), ("/awsome", 404)):
            with pytest.raises(urllib.error.HTTPError) as caught:
                urllib.request.urlopen(f"{served.url}{path}", b"{}", timeout=60)
            assert caught.value.code == status, path
