"""Roles files, and users of a real S3 server that roles stand for."""

import json
from collections.abc import Sequence
from pathlib import Path
from uuid import uuid4

from helpers.s3_server import S3Server


def roles_file(folder: Path, *roles: str) -> Path:
    """Writes a roles file; each role is the TOML of one."""
    path = folder / "roles.toml"
    path.write_text("\n".join(f"[[role]]\n{role}" for role in roles))
    path.chmod(0o600)
    return path


def user(server: S3Server, reads: Sequence[str] = (), writes: Sequence[str] = ()) -> tuple[str, str]:
    """Makes a user who may read and write places such as `bucket/folder/*`; returns the keys."""
    iam, name = server.client("iam"), f"user-{uuid4().hex[:8]}"
    iam.create_user(UserName=name)
    statements = [
        {"Effect": "Allow", "Action": actions, "Resource": [f"arn:aws:s3:::{place}" for place in places]}
        for actions, places in (
            (["s3:GetObject"], reads),
            (["s3:GetObject", "s3:PutObject", "s3:AbortMultipartUpload"], writes),
        )
        if places
    ]
    policy = json.dumps({"Version": "2012-10-17", "Statement": statements})
    iam.put_user_policy(UserName=name, PolicyName="places", PolicyDocument=policy)
    keys = iam.create_access_key(UserName=name)["AccessKey"]
    return keys["AccessKeyId"], keys["SecretAccessKey"]


def role_with_keys(arn: str, keys: tuple[str, str]) -> str:
    """The TOML of a role with keys."""
    return f'arn = "{arn}"\naccess_key_id = "{keys[0]}"\nsecret_access_key = "{keys[1]}"\n'
