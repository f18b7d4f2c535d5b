"""boto3 sessions that share botocore's data loader, so that service models are read once in a process."""

from functools import cache

import botocore.session
from boto3 import Session
from botocore.loaders import Loader, create_loader


def new_session(
    access_key_id: str | None = None,
    secret_access_key: str | None = None,
    session_token: str | None = None,
    profile_name: str | None = None,
    inner: botocore.session.Session | None = None,
) -> Session:
    """Opens a boto3 session; missing credentials come from where AWS tools find them.

    botocore gives every session a loader of its own, and a session's first client reads the addresses and the model
    of its service with it: 2 MB of JSON, most of the time that opening a store takes.

    Args:
        access_key_id: The public half of a key.
        secret_access_key: The secret half of the key.
        session_token: Session token of a temporary key.
        profile_name: A profile of AWS's files.
        inner: The session of botocore that is used; by default a new one.

    Raises:
        BotoCoreError: The AWS profile does not exist, or only half of a key is given.
    """
    inner = inner or botocore.session.get_session()
    session = Session(
        aws_access_key_id=access_key_id,
        aws_secret_access_key=secret_access_key,
        aws_session_token=session_token,
        botocore_session=inner,
        profile_name=profile_name,
    )
    # Only now: boto3 adds a folder to the loader that it finds, which would become one more for each session.
    inner.register_component("data_loader", _loader(inner.get_config_variable("data_path")))
    return session


@cache
def _loader(data_path: str | None) -> Loader:
    return create_loader(data_path)
