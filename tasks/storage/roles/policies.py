"""S3 policy of a role: the places that it may read and write."""

import json
from typing import Any

from ....schemas.roles import Role

_READ = ("s3:GetObject",)
_WRITE = ("s3:GetObject", "s3:PutObject", "s3:DeleteObject", "s3:AbortMultipartUpload")
_ARN = "arn:aws:s3:::"


def policy_of(role: Role) -> str:
    """The policy, as JSON: objects in the role's places, and lists of their keys."""
    statements: list[dict[str, Any]] = []
    for places, actions in ((role.read, _READ), (role.write, _WRITE)):
        if places:
            resources = [f"{_ARN}{place}" for place in places]
            statements.append({"Effect": "Allow", "Action": list(actions), "Resource": resources})
    for bucket, prefixes in _listed(role).items():
        statements.append(
            {
                "Effect": "Allow",
                "Action": ["s3:ListBucket"],
                "Resource": [f"{_ARN}{bucket}"],
                "Condition": {"StringLike": {"s3:prefix": prefixes}},
            }
        )
    return json.dumps({"Version": "2012-10-17", "Statement": statements})


def _listed(role: Role) -> dict[str, list[str]]:
    """The prefixes that may be listed, by bucket."""
    found: dict[str, list[str]] = {}
    for place in (*role.read, *role.write):
        bucket, _, prefix = place.partition("/")
        found.setdefault(bucket, []).append(prefix)
    return found


def buckets_of(role: Role) -> set[str]:
    """The buckets of a role's places."""
    return {place.partition("/")[0] for place in (*role.read, *role.write)}
