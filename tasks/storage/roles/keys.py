"""The credentials of a role as they are at one moment, and how blocks of Prefect are read for them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

ReadBlock = Callable[[str, str], Mapping[str, Any] | None]
"""The content of a block of Prefect, with its secrets, by its type's slug and its name; `None`: there is none."""


@dataclass(frozen=True)
class Keys:
    """Credentials as they are now."""

    access_key_id: str
    secret_access_key: str = field(repr=False)
    session_token: str | None = field(default=None, repr=False)
    expires_at: datetime | None = None
    """When they run out; `None`: they do not, or it is not said when."""
