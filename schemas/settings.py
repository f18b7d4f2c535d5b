"""Where things are kept and who one is, read from environment variables.

| variable | meaning | default |
| --- | --- | --- |
| `ROBOMAKER_HOME` | folder for everything this program keeps | the platform's data folder |
| `ROBOMAKER_CATALOG_URL` | SQLAlchemy URL of the catalog | SQLite under the home |
| `ROBOMAKER_OBJECT_STORE` | folder, or URL of an S3 endpoint (`https://…`), or `aws` | `objects` under the home |
| `ROBOMAKER_REGION`, `ROBOMAKER_ACCOUNT` | what ARNs say | `us-east-1`, `000000000000` |
| `ROBOMAKER_BUCKET` | bucket for worlds, and for outputs that name none | `robomaker` |
| `ROBOMAKER_MAX_JOBS` | simulation jobs at once when a batch names no `maxConcurrency` | number of CPUs |
| `PREFECT_API_URL` | Prefect server to use | a local one, started when needed |
"""

import os
import re
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import quote

import platformdirs
from pydantic import Field, ValidationError

from .base import Model
from .errors import ConfigurationError
from .request_problems import problems_of

# All of ASCII but what has a meaning in the path of a database's URL.
_PLAIN_IN_URLS = "".join(map(chr, range(128))).replace("%", "").replace("?", "")


class Settings(Model):
    """All settings, resolved."""

    home: Path = Field(description="Folder for everything this program keeps.")
    catalog_url: str = Field(description="SQLAlchemy URL of the catalog.")
    object_store: str = Field(description="A folder, the URL of an S3 endpoint, or `aws`.")
    region: str = Field(default="us-east-1", pattern=r"^[a-z0-9-]+$", description="Region in ARNs and for S3.")
    account: str = Field(default="000000000000", pattern=r"^[0-9]{12}$", description="Account in ARNs.")
    bucket: str = Field(
        default="robomaker",
        pattern=r"^[a-z0-9][a-z0-9.\-]{1,61}[a-z0-9]$",
        description="Bucket for worlds, and for outputs that name none.",
    )
    max_jobs: int = Field(ge=1, description="Simulation jobs at once when a batch names no maxConcurrency.")

    @classmethod
    def from_environment(cls, environ: Mapping[str, str]) -> "Settings":
        """Reads the settings.

        Args:
          environ: environment variables, usually `os.environ`.

        Raises:
          ConfigurationError: a variable has a value that cannot be used.
        """
        home = Path(environ.get("ROBOMAKER_HOME") or platformdirs.user_data_path("robomaker")).expanduser().resolve()
        max_jobs = environ.get("ROBOMAKER_MAX_JOBS") or str(os.cpu_count() or 1)
        if not re.fullmatch(r"[1-9][0-9]{0,3}", max_jobs):
            raise ConfigurationError(f"ROBOMAKER_MAX_JOBS is {max_jobs!r}; it has to be a number from 1 to 9999")
        values: dict[str, object] = {
            "home": home,
            "catalog_url": environ.get("ROBOMAKER_CATALOG_URL")
            or f"sqlite:///{quote(str(home), safe=_PLAIN_IN_URLS)}/catalog.db",
            "object_store": environ.get("ROBOMAKER_OBJECT_STORE") or str(home / "objects"),
            "max_jobs": int(max_jobs),
        }
        for name in ("region", "account", "bucket"):
            if value := environ.get(f"ROBOMAKER_{name.upper()}"):
                values[name] = value
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            problem = problems_of(error, cls)[0]
            raise ConfigurationError(f"ROBOMAKER_{problem.path}".upper() + f" {problem.message}") from error
