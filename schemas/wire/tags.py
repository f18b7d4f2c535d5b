"""Tags of resources as requests and responses carry them: keys, values, and how many a resource may have."""

from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, Field

from .base import ShapeName
from .common import text

_Text = TypeVar("_Text", bound=str)


def _no_reserved_tags(tags: dict[_Text, Any]) -> dict[_Text, Any]:
    if reserved := sorted(key for key in tags if key.lower().startswith("aws:")):
        raise ValueError(f"tag keys that begin with 'aws:' are reserved; rename {', '.join(map(repr, reserved))}")
    return tags


TagKey = Annotated[str, ShapeName("TagKey"), text(1, 128, r"[a-zA-Z0-9 _.\-\/+=:]*")]
TagValue = Annotated[str, ShapeName("TagValue"), text(0, 256, r"[a-zA-Z0-9 _.\-\/+=:]*")]
MAX_TAGS = 50
"""Maximum number of tags of a resource."""
TagMap = Annotated[
    dict[TagKey, TagValue],
    ShapeName("TagMap"),
    Field(max_length=MAX_TAGS),
    AfterValidator(_no_reserved_tags),
]
