"""Settings of fleets, read from environment variables; `docs/settings.md` is generated from their descriptions."""

from pydantic import Field

from ..settings import Settings
from ..wire.base import Model

WING = "fleet"


class FleetSettings(Model):
    """All settings of robot fleets and deployments, read from environment variables."""

    robots_url: str | None = Field(
        default=None,
        pattern=r"^https?://[^/\s]+/?$",
        description="Address at which robots reach the endpoint, such as a proxy that adds TLS, without a path; none: "
        "as each of their requests says.",
    )
    robot_poll_s: int = Field(
        default=30,  # the shortest that hawkBit asks for
        ge=1,
        le=24 * 3600 - 1,  # the longest that clients of hawkBit can be told
        description="Seconds between two polls of a robot that has nothing to do.",
    )
    robot_folder: str = Field(
        default="/opt/robomaker",
        pattern=r"^(/[A-Za-z0-9_][A-Za-z0-9._-]*)+$",
        description="Folder on robots that applications are unpacked below, an absolute path.",
    )

    @classmethod
    def of(cls, settings: Settings) -> "FleetSettings":
        """Returns the fleet settings that are part of the program's settings, or the defaults if those contain none."""
        found = settings.of_wings.get(WING)
        return found if isinstance(found, cls) else cls()


SETTINGS = FleetSettings
