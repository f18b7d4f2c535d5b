"""Settings of fleets, read from environment variables.

| variable | meaning | default |
| --- | --- | --- |
| `ROBOMAKER_ROBOT_POLL_S` | seconds between two polls of a robot that has nothing to do, 1 to 86399 | 30 |
| `ROBOMAKER_ROBOTS_URL` | where robots reach `robomaker serve`, such as a proxy that adds TLS | as robots ask for it |
| `ROBOMAKER_ROBOT_FOLDER` | folder on robots that applications are unpacked below | `/opt/robomaker` |
"""

from pydantic import Field

from ..settings import Settings
from ..wire.base import Model

WING = "fleet"


class FleetSettings(Model):
    """All settings of robot fleets and deployments, read from environment variables."""

    robots_url: str | None = Field(
        default=None,
        pattern=r"^https?://[^/\s]+/?$",
        description="Address at which robots reach the endpoint, without a path; None: as each of their requests says.",
    )
    robot_poll_s: int = Field(
        default=30,  # the shortest that hawkBit asks for
        ge=1,
        le=24 * 3600 - 1,  # the longest that clients of hawkBit can be told
        description="Between two polls of a robot that has nothing to do, in seconds.",
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
