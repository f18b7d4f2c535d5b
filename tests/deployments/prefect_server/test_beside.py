"""Jobs beside the server: they get a client that works, one that fails harms no other, all end with the server."""

import asyncio
import logging

import pytest
from helpers.prefect_server import server_settings
from prefect.client.orchestration import PrefectClient

from prefect_robomaker.deployments.prefect_server.secret import auth_string


def test_a_job_may_write_to_the_server_and_ends_with_it(prefect_server: str, caplog: pytest.LogCaptureFixture) -> None:
    from prefect_robomaker.deployments.prefect_server.server_process import beside  # imports Prefect's server: 2 s

    ended: list[str] = []

    async def fail(client: PrefectClient) -> None:
        raise ValueError("no reason")

    async def write_and_wait(client: PrefectClient) -> None:
        await client.create_flow_from_name("made-beside-the-server")
        written.set()
        try:
            await asyncio.sleep(3600)
        finally:
            ended.append("cancelled")

    async def run() -> None:
        async with beside((fail, write_and_wait), prefect_server, auth_string(server_settings())):
            await asyncio.wait_for(written.wait(), 200)

    written = asyncio.Event()
    with caplog.at_level(logging.ERROR):
        asyncio.run(run())

    assert ended == ["cancelled"]
    assert "fail beside the Prefect server failed" in caplog.text
    assert "no reason" in caplog.text
