"""A socket of events on which a client logs in twice, as Prefect's does when two of its tasks connect again at once."""

import asyncio
import json
import uuid
from datetime import UTC, datetime, timedelta
from typing import Any

from helpers.prefect_server import server_settings
from helpers.processes import wait_for
from prefect.client.orchestration import get_client
from websockets.asyncio.client import connect
from websockets.typing import Subprotocol

from prefect_robomaker.deployments.prefect_server.secret import auth_string


def event(name: str) -> dict[str, Any]:
    return {
        "occurred": datetime.now(UTC).isoformat(),
        "event": name,
        "resource": {"prefect.resource.id": name},
        "id": str(uuid.uuid4()),
    }


def was_received(name: str) -> bool:
    since = (datetime.now(UTC) - timedelta(minutes=10)).isoformat()
    wanted = {"filter": {"event": {"name": [name]}, "occurred": {"since": since}}}
    with get_client(sync_client=True) as client:
        return bool(client.request("POST", "/events/filter", json=wanted).json()["events"])


def test_what_comes_after_a_second_login_arrives(prefect_server: str) -> None:
    secret = auth_string(server_settings())
    name = f"twice-{uuid.uuid4().hex}"
    log = server_settings().home / "prefect" / "server.log"
    before = log.read_text(errors="replace")

    async def send() -> None:
        address = f"{prefect_server.replace('http', 'ws')}/events/in"
        async with connect(address, subprotocols=[Subprotocol("prefect")]) as socket:
            login = json.dumps({"type": "auth", "token": secret})
            await socket.send(login)
            assert json.loads(await socket.recv()) == {"type": "auth_success"}
            await socket.send(login)
            await socket.send(json.dumps(event(name)))

    asyncio.run(send())

    wait_for(lambda: was_received(name), "the event")
    assert "Traceback" not in log.read_text(errors="replace")[len(before) :]
