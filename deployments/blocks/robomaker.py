"""Prefect blocks that hold settings; each converts to the environment variables that it stands for.

`_block_type_slug` is part of what deployments keep (`deploying/job_variables.py`): renaming one breaks them.
"""

from typing import TYPE_CHECKING, Any, ClassVar, cast
from urllib.parse import urlsplit

from prefect.blocks.core import Block
from pydantic import Field, HttpUrl, SecretStr

if TYPE_CHECKING:
    from ...tasks.service.service import Service

_PAGE = "https://pypi.org/project/prefect-robomaker/"


class _WithLogo:
    """Base class that gives a block type a logo, which only this package's own Prefect server has."""

    @classmethod
    def _to_block_type(cls) -> Any:
        from prefect.settings import PREFECT_API_URL

        from ..prefect_server.login_page import LOGO

        block_type = cast("Any", super())._to_block_type()
        url = urlsplit(PREFECT_API_URL.value() or "")
        if url.scheme == "http" and url.hostname == "127.0.0.1":
            block_type.logo_url = HttpUrl(f"http://{url.netloc}{LOGO}")
        return block_type


class RobomakerCredentials(_WithLogo, Block):
    """Prefect block with the access key of an S3 object store.

    Members have the names that prefect-aws's `AwsCredentials` has, whose blocks do as well wherever a deployment takes
    settings from blocks.

    Example:
        ```python
        from prefect_robomaker.deployments.blocks import RobomakerCredentials

        credentials = RobomakerCredentials.load("BLOCK_NAME")
        ```
    """

    _block_type_name = "RoboMaker Credentials"
    _block_type_slug = "robomaker-credentials"
    _documentation_url: ClassVar[str] = _PAGE  # pyright: ignore[reportIncompatibleVariableOverride] - sent as text

    aws_access_key_id: str = Field(description="The access key's id.")
    aws_secret_access_key: SecretStr = Field(description="The access key itself.")
    aws_session_token: SecretStr | None = Field(default=None, description="Token of a temporary access key.")

    def environment(self) -> dict[str, str]:
        """Returns the environment variables that the block's settings become, with secrets in clear text."""
        found = {
            "AWS_ACCESS_KEY_ID": self.aws_access_key_id,
            "AWS_SECRET_ACCESS_KEY": self.aws_secret_access_key.get_secret_value(),
        }
        if self.aws_session_token:
            found["AWS_SESSION_TOKEN"] = self.aws_session_token.get_secret_value()
        return found


class RobomakerObjectStore(_WithLogo, Block):
    """Prefect block with the settings of the object store for worlds, application archives and outputs.

    Example:
        ```python
        from prefect_robomaker.deployments.blocks import RobomakerObjectStore

        store = RobomakerObjectStore.load("BLOCK_NAME")
        ```
    """

    _block_type_name = "RoboMaker Object Store"
    _block_type_slug = "robomaker-object-store"
    _documentation_url: ClassVar[str] = _PAGE  # pyright: ignore[reportIncompatibleVariableOverride]

    address: str = Field(description="URL of an S3 endpoint, `aws`, or a folder that all workers reach.")
    bucket: str | None = Field(default=None, description="Bucket for worlds, and for outputs that name none.")
    region: str | None = Field(default=None, description="Region in ARNs and for S3.")
    credentials: RobomakerCredentials | None = Field(
        default=None, description="Access key; without one, S3 clients look where they always do."
    )

    def environment(self) -> dict[str, str]:
        """Returns the environment variables that the block's settings become, with secrets in clear text."""
        given = {
            "ROBOMAKER_OBJECT_STORE": self.address,
            "ROBOMAKER_BUCKET": self.bucket,
            "ROBOMAKER_REGION": self.region,
        }
        found = {name: value for name, value in given.items() if value}
        return found | (self.credentials.environment() if self.credentials else {})


class RobomakerCatalog(_WithLogo, Block):
    """Prefect block with the settings of the catalog, the database of jobs, worlds and applications.

    Example:
        ```python
        from prefect_robomaker.deployments.blocks import RobomakerCatalog

        catalog = RobomakerCatalog.load("BLOCK_NAME")
        ```
    """

    _block_type_name = "RoboMaker Catalog"
    _block_type_slug = "robomaker-catalog"
    _documentation_url: ClassVar[str] = _PAGE  # pyright: ignore[reportIncompatibleVariableOverride]

    url: SecretStr = Field(description="SQLAlchemy URL, such as `postgresql+psycopg://user:password@host/catalog`.")

    def environment(self) -> dict[str, str]:
        """Returns the environment variables that the block's settings become, with secrets in clear text."""
        return {"ROBOMAKER_CATALOG_URL": self.url.get_secret_value()}


def open_service(*blocks: RobomakerCatalog | RobomakerObjectStore | RobomakerCredentials) -> "Service":
    """Opens the RoboMaker service with settings from Prefect blocks; environment variables give the rest.

    ```python
    with open_service(RobomakerObjectStore.load("lab"), RobomakerCatalog.load("lab")).activated():
        CreateSimulationJob(...)
    ```

    Raises:
        ConfigurationError: A setting leads nowhere.
        StorageError: The object store does not answer.
    """
    import os

    from ...schemas.settings import Settings
    from ...tasks.service.service import Service

    environ = dict(os.environ)
    for block in blocks:
        environ |= block.environment()
    return Service.open(Settings.from_environment(environ), environ)
