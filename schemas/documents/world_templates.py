"""The document of a world template."""

from pydantic import Field

from ..wire.base import optional
from .base import Changes, Document


class TemplateBody(Changes):
    """The members that a template's body decides."""

    version: str = Field(description="The body's version.")
    template_body: str = Field(description="The body as text, as it was given.")


class WorldTemplateDocument(TemplateBody, Document):
    """A world template."""

    client_request_token: str | None = optional("Token of the request that created it.")
