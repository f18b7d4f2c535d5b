"""Base classes of all catalog documents: reading from and writing to the catalog's JSON, and format versions."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, Protocol, Self

from pydantic import BaseModel, ConfigDict, Field, PlainSerializer, model_serializer
from pydantic.alias_generators import to_camel

from ..wire.base import optional
from ..wire.errors import ConfigurationError

VERSION_KEY = "schema_version"
"""Name of the member with a stored document's format version; documents without it have version 1."""

Migration = Callable[[dict[str, Any]], dict[str, Any]]
"""Function that converts a stored document of one format version to the next."""

Json = Annotated[dict[str, Any], PlainSerializer(lambda value: value, return_type=Any)]
"""A JSON object that is stored unchanged, such as a request as the caller sent it."""


class StoredResource(Protocol):
    """A resource of the catalog (job, world, robot, ...), reduced to its ARN and its stored document."""

    @property
    def arn(self) -> str:
        """ARN of the resource, its unique name."""
        ...

    @property
    def document(self) -> Mapping[str, Any]:
        """The resource's document as JSON, as the catalog stores it."""
        ...


class _Stored(BaseModel):
    """Base class of all objects that are stored under camelCase names."""

    model_config = ConfigDict(
        alias_generator=to_camel, validate_by_name=True, validate_by_alias=True, frozen=True, defer_build=True
    )


class Part(_Stored):
    """Base class of objects inside a catalog document; members that are `None` are left out of the stored JSON."""

    @model_serializer(mode="plain")
    def _present(self) -> dict[str, Any]:
        members = {
            field.serialization_alias or name: getattr(self, name) for name, field in type(self).model_fields.items()
        }
        return {name: value for name, value in {**members, **(self.model_extra or {})}.items() if value is not None}

    def to_json(self) -> dict[str, Any]:
        """Returns the object as plain JSON values, under the member names that the catalog stores."""
        return self.model_dump(mode="json", by_alias=True)


class Changes(_Stored):
    """Base class of updates to a catalog document: only members that are set explicitly are written."""

    model_config = ConfigDict(extra="forbid")

    def to_json(self) -> dict[str, Any]:
        """Returns only the members that were set explicitly, as plain JSON values under their stored names."""
        return self.model_dump(mode="json", by_alias=True, exclude_unset=True)

    def without(self, *names: str) -> Self:
        """Returns a copy of this update without the named members, which then stay unchanged in the document."""
        return type(self)(**{name: getattr(self, name) for name in self.model_fields_set.difference(names)})

    @classmethod
    def of_members(cls, resource: StoredResource) -> Self:
        """Reads this update's members from a catalog resource that was listed with only these members.

        Raises pydantic's ValidationError if a member has a wrong value.
        """
        return cls.model_validate(resource.document)

    @classmethod
    @cache  # lists ask for each of thousands
    def members(cls) -> tuple[str, ...]:
        """Returns the stored names of all members of this class, to ask a list for only these."""
        return tuple(field.serialization_alias or name for name, field in cls.model_fields.items())


class Brief(Changes):
    """Base class of excerpts from a document, for lists that show a few members and need not read the rest."""

    @classmethod
    def of(cls, resource: StoredResource) -> Self:
        """Reads this excerpt from a catalog resource; other members of its document are ignored.

        Raises pydantic's ValidationError if a member has a wrong value.
        """
        return cls.model_validate(
            {name: resource.document[name] for name in cls.members() if name in resource.document}
        )


class FailureChanges(Changes):
    """Update to a job's document with the reason for its failure: failure code and text."""

    failure_code: str | None = optional("Failure code of the job; absent if it did not fail.")
    failure_reason: str | None = optional("Reason of the failure as text.")


class Document(Changes):
    """Base class of catalog documents: all stored data of a resource besides its name, status and tags."""

    # Members of newer releases that share this version are left alone.
    model_config = ConfigDict(extra="ignore")

    MIGRATIONS: ClassVar[tuple[Migration, ...]] = ()
    """Functions that each convert a document to the next format version, beginning with version 1."""

    schema_version: Literal[1] = Field(default=1, alias=VERSION_KEY, description="Format version of this document.")

    @classmethod
    def of(cls, resource: StoredResource) -> Self:
        """Reads a catalog resource's document; documents of earlier releases are converted.

        Raises:
            ConfigurationError: A newer release wrote the document.
        """
        return cls.model_validate(cls.upgraded(resource.document, resource.arn))

    @classmethod
    def upgraded(cls, stored: Mapping[str, Any], arn: str) -> Mapping[str, Any]:
        """Converts a stored document to the format version of this release.

        Args:
            stored: The document.
            arn: ARN of the document's resource, for messages.

        Raises:
            ConfigurationError: A newer release wrote the document.
        """
        version, newest = stored.get(VERSION_KEY) or 1, len(cls.MIGRATIONS) + 1
        if version == newest:
            return stored
        if version > newest:
            raise ConfigurationError(
                f"the document of {arn} has version {version}, this program knows {newest}; update this program"
            )
        document = dict(stored)
        for number, migration in enumerate(cls.MIGRATIONS[version - 1 :], version + 1):
            document = {**migration(document), VERSION_KEY: number}
        return document

    def to_json(self) -> dict[str, Any]:
        """Returns the whole document as JSON for the catalog: its format version and the members that were set."""
        return {VERSION_KEY: len(self.MIGRATIONS) + 1, **super().to_json()}
