"""Blocks: Prefect's own suite for them, and that what they keep comes back."""

import asyncio
import os
import subprocess
import sys
from pathlib import Path

import httpx
import pytest
from prefect.blocks.core import Block
from prefect.client.orchestration import get_client
from prefect.plugins import load_prefect_collections
from prefect.testing.standard_test_suites.blocks import BlockStandardTestSuite
from prefect.utilities.templating import resolve_block_document_references
from pydantic import SecretStr

from prefect_robomaker.deployments import blocks
from prefect_robomaker.deployments.blocks import (
    RobomakerCatalog,
    RobomakerCredentials,
    RobomakerObjectStore,
    open_service,
)
from prefect_robomaker.deployments.deploying.job_variables import BLOCK_VARIABLES, environment_of_blocks
from prefect_robomaker.deployments.deploying.registration import read_block

BLOCKS = (RobomakerCatalog, RobomakerCredentials, RobomakerObjectStore)


@pytest.mark.parametrize("block", BLOCKS)
class TestBlocks(BlockStandardTestSuite):
    @pytest.fixture
    def block(self, request: pytest.FixtureRequest) -> type[Block]:
        return request.param

    def test_has_a_valid_image(self, block: type[Block]) -> None:
        """The suite's own wants one from the web, and a private server's pages should ask nobody for one."""
        assert block._logo_url is None


def test_the_pages_of_our_server_get_the_logo_from_it(prefect_server: str) -> None:
    RobomakerCatalog(url=SecretStr("sqlite://")).save("with-logo", overwrite=True)

    with get_client(sync_client=True) as client:
        logo = client.read_block_type_by_slug("robomaker-catalog").logo_url
    assert str(logo) == f"{prefect_server.removesuffix('/api')}/robomaker/logo.svg"
    assert httpx.get(str(logo)).headers["content-type"] == "image/svg+xml"


@pytest.mark.parametrize("block", BLOCKS)
def test_deployments_take_every_member_of_a_block(block: type[Block]) -> None:
    slug = block._block_type_slug
    assert slug is not None
    assert {path.partition(".")[0] for path in BLOCK_VARIABLES[slug].values()} == set(block.model_fields)


def test_a_saved_block_comes_back_as_the_variables_that_it_stands_for(prefect_server: str) -> None:
    credentials = RobomakerCredentials(aws_access_key_id="id", aws_secret_access_key=SecretStr("hidden"))
    store = RobomakerObjectStore(address="http://127.0.0.1:9000", bucket="runs", credentials=credentials)
    store.save("lab", overwrite=True)
    RobomakerCatalog(url=SecretStr("postgresql+psycopg://u:p@h/c")).save("lab", overwrite=True)

    assert RobomakerObjectStore.load("lab").environment() == {  # type: ignore[union-attr] # sync here
        "ROBOMAKER_OBJECT_STORE": "http://127.0.0.1:9000",
        "ROBOMAKER_BUCKET": "runs",
        "AWS_ACCESS_KEY_ID": "id",
        "AWS_SECRET_ACCESS_KEY": "hidden",
    }
    assert RobomakerCatalog.load("lab").environment() == {"ROBOMAKER_CATALOG_URL": "postgresql+psycopg://u:p@h/c"}  # type: ignore[union-attr]


def test_what_a_worker_makes_of_a_deployments_references_is_what_the_block_stands_for(prefect_server: str) -> None:
    credentials = RobomakerCredentials(
        aws_access_key_id="id", aws_secret_access_key=SecretStr("hidden"), aws_session_token=SecretStr("brief")
    )
    block = RobomakerObjectStore(address="http://127.0.0.1:9000", region="eu-west-1", credentials=credentials)
    block.save("references", overwrite=True)

    with get_client(sync_client=True) as client:
        kept = environment_of_blocks(
            ["robomaker-object-store/references"], lambda slug, name: read_block(client, slug, name)
        )
    resolved = asyncio.run(resolve_block_document_references(kept))

    assert "hidden" not in str(kept)
    assert resolved == block.environment()


def test_a_service_opens_with_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOMAKER_HOME", str(tmp_path / "home"))

    service = open_service(
        RobomakerObjectStore(address=str(tmp_path / "objects"), bucket="runs"),
        RobomakerCatalog(url=SecretStr(f"sqlite:///{tmp_path}/elsewhere.db")),
    )

    assert (service.settings.bucket, service.settings.object_store) == ("runs", str(tmp_path / "objects"))
    assert (tmp_path / "elsewhere.db").exists()
    service.catalog.close()


def test_prefect_finds_the_blocks() -> None:
    assert load_prefect_collections()["prefect_robomaker"] is blocks


@pytest.mark.deep
def test_prefects_command_registers_the_blocks(prefect_server: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "prefect", "block", "register", "-m", "prefect_robomaker.deployments.blocks"]
    environ = {**os.environ, "PREFECT_API_URL": prefect_server, "PREFECT_HOME": str(tmp_path)}
    done = subprocess.run(command, env=environ, capture_output=True, text=True, check=False, timeout=290)

    assert "Successfully registered 3 blocks" in done.stdout, done.stderr
