"""The box that the processes of a run are in: how strong it is, and what it lets them see."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from ..wire.base import Model

SandboxMode = Literal["auto", "require", "off"]
BoxLevel = Literal["box", "landlock", "none"]
"""`box`: namespaces of its own; `landlock`: rules of the kernel for files; `none`: nothing."""
BoxNetwork = Literal["full", "none"]


class BoxPlan(Model):
    """What a run is confined to."""

    level: BoxLevel = Field(default="none", description="How its processes are confined.")
    network: BoxNetwork = Field(
        default="full",
        description="What they reach: the machine's network, or only each other.",
    )
    shown: list[Path] = Field(default=[], description="Files and folders that they may read besides their own.")
    hidden: list[Path] = Field(default=[], description="What they must not see, wherever it lies.")
