"""The document of a world."""

from pydantic import Field

from ..wire.base import optional
from .base import Document, Part


class StoredPlace(Part):
    """Place of a folder of files in the object store."""

    bucket: str = Field(description="Bucket.")
    prefix: str = Field(description="Prefix of all keys of its files; its last part names the content or run.")

    @property
    def last_part(self) -> str:
        """Last part of the prefix, which names the content or run."""
        return self.prefix.rpartition("/")[2]


class WorldDocument(Document):
    """A world."""

    template: str | None = optional("ARN of the template it was generated from.")
    bundle: StoredPlace | None = optional("Place of its bundle.")
    reused_from: str | None = optional("ARN of the world whose bundle it shares; absent: it was generated.")
    description_key: str | None = optional(
        "Key of its description in the bundle's bucket; worlds of early releases have none."
    )
