"""Worlds of a run, with their floor plans and pictures."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from markupsafe import Markup

from ...schemas.reports.names import short_name
from ...schemas.wire.errors import RobomakerError
from ...tasks.catalog import Resource
from ...tasks.service.service import Service
from ...tasks.simulations.inputs.bundles import world_bundle
from ...tasks.worlds.previews import preview_of
from .html import card, image, line


@dataclass(frozen=True)
class World:
    """World that a run made or used."""

    arn: str
    name: str
    """Name of a world for people: `flat 3`; its id where it has none."""
    _service: Service = field(repr=False, compare=False)

    @property
    def id(self) -> str:
        """Id of the world: `generation-…/world-3`."""
        return short_name(self.arn)

    @cached_property
    def _resource(self) -> Resource:
        return self._service.catalog.get(self.arn, kind="world")

    @cached_property
    def folder(self) -> Path:
        """Folder of its files on this machine: `world.xml`, `world.json`, the map; they are downloaded if necessary.

        Raises:
            ResourceNotFoundException: The world was deleted.
            StorageError: Its files cannot be fetched.
        """
        return world_bundle(self._resource, self._service)

    @cached_property
    def plan(self) -> str:
        """Floor plan of a world as SVG; it raises errors as `folder` does."""
        return (self.folder / "floorplan.svg").read_text(encoding="utf-8")

    @cached_property
    def picture(self) -> bytes:
        """Picture of a world from above as PNG; empty if it cannot be drawn. It raises errors as `folder` does."""
        return preview_of(self._resource, self._service)

    def drawing(self) -> Markup:
        """Returns the floor plan as an image for a page, or the reason why there is none."""
        try:
            return image(self.plan.encode(), "image/svg+xml", f"Plan of {self.name}")
        except (RobomakerError, OSError) as error:
            return line(f"There is no plan: {error}")

    def _repr_html_(self) -> str:
        try:
            picture = image(self.picture, "image/png", f"{self.name} from above")
        except RobomakerError:
            picture = Markup("")  # the plan says why
        return str(card(self.name, "", Markup("<div>{}{}</div>").format(self.drawing(), picture), own_id=self.id))
