"""Reads credentials of access roles from Prefect blocks."""

from collections.abc import Mapping
from typing import Any


def read_credential_block(slug: str, name: str) -> Mapping[str, Any] | None:
    """Reads a Prefect block with credentials, including its secrets, from the server; `None` if it does not exist.

    It is read as it is stored, so its type need not be installed here: prefect-aws binds boto3 to old releases.

    Args:
        slug: Slug of its type.
        name: Name of the block.
    """
    from prefect.client.orchestration import get_client  # only roles that are blocks wait for its import
    from prefect.exceptions import ObjectNotFound

    with get_client(sync_client=True) as client:
        try:
            return client.read_block_document_by_name(name=name, block_type_slug=slug, include_secrets=True).data
        except ObjectNotFound:
            return None
