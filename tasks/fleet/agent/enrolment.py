"""Enrols a robot at the service: sends a one-time token and a token that the robot made itself, gets the root of trust.

The answer may get lost, so the request is on disk before it is sent, and the same is sent again.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from dataclasses import replace
from typing import Any, Callable

from .disk import prepare
from .errors import AgentError, TryLater
from .journal import Journal, write_durably
from .server import exchange
from .settings import Connection, Home

_TOKEN = re.compile(r"(?P<token>[A-Za-z0-9]{40})-(?P<root>[0-9a-f]{64})")
_TOKEN_BYTES = 32

Exchange = Callable[[Connection, str, str, bytes, "dict[str, str]"], "tuple[int, bytes]"]


def enrol(
    home: Home,
    connection: Connection,
    enrolment_token: str,
    random_bytes: Callable[[int], bytes],
    *,
    again: bool = False,
    exchange: Exchange = exchange,
) -> Connection:
    """Enrols a robot at the service with its one-time token.

    Args:
        home: The agent's data folder.
        connection: URL, tenant, name and token of the robot; its token is made here.
        enrolment_token: One-time token that `robomaker robots enroll NAME --agent` printed.
        random_bytes: Makes the robot's token.
        again: Forget the server that it is enrolled with; versions stay and run on.
        exchange: Sends a request.

    Raises:
        AgentError: The token is not right or used up, the root is another one, or the robot is enrolled already.
    """
    found = _TOKEN.fullmatch(enrolment_token.strip())
    if found is None:
        raise AgentError("TOKEN is not right; 40 letters and digits, '-', and 64 hexadecimal digits are")
    if home.connection_file.exists() and not again:
        raise AgentError(f"{home.folder} is enrolled already; --again enrolls it anew")
    prepare(home)
    connection = replace(connection, token=_own_token(home, enrolment_token, random_bytes))
    root = _root(connection, found["token"], exchange)
    if hashlib.sha256(root).hexdigest() != found["root"]:
        raise AgentError(
            f"the server's root of trust has SHA-256 {hashlib.sha256(root).hexdigest()}, the token says "
            f"{found['root']}; nothing was stored: ask who runs the fleet for another token"
        )
    _forget_trust(home)
    write_durably(home.root_file, root)
    home.save_connection(connection)
    (home.folder / "enrolling.json").unlink()
    return connection


def _own_token(home: Home, enrolment_token: str, random_bytes: Callable[[int], bytes]) -> str:
    """Returns the token that this robot made for the enrolment; the same at every attempt with one enrolment token.

    A new token is written to the home folder before it is returned.
    """
    path = home.folder / "enrolling.json"
    used_for = hashlib.sha256(enrolment_token.strip().encode()).hexdigest()
    try:
        kept: dict[str, Any] = json.loads(path.read_bytes())
        if kept["enrolment"] == used_for:
            return kept["token"]
    except (FileNotFoundError, ValueError, KeyError):
        pass
    token = random_bytes(_TOKEN_BYTES).hex()
    write_durably(path, json.dumps({"enrolment": used_for, "token": token}).encode())
    return token


def _root(connection: Connection, enrolment_token: str, exchange: Exchange) -> bytes:
    path = f"/{connection.tenant}/agents/v1/{connection.robot}/enrolment"
    body = json.dumps({"tokenSha256": hashlib.sha256(connection.token.encode()).hexdigest()}).encode()
    headers = {"Authorization": f"EnrolmentToken {enrolment_token}", "Content-Type": "application/json"}
    try:
        status, answer = exchange(connection, "POST", path, body, headers)
    except TryLater as error:
        raise AgentError(f"the server cannot be reached; the same command may be repeated: {error}") from error
    if status == 401:
        raise AgentError(
            f"the server does not take the token for {connection.robot}: it is used up, or older than an hour"
        )
    try:
        if status == 200:
            return json.loads(answer)["root"].encode()
    except (ValueError, KeyError, AttributeError, TypeError):
        pass
    raise AgentError(f"{connection.url}{path}: the answer is not right (HTTP status {status})")


def _forget_trust(home: Home) -> None:
    """Deletes the stored TUF metadata and the journal's minimum versions of TUF roles.

    A repository with another root begins with versions of its own.
    """
    shutil.rmtree(home.metadata, ignore_errors=True)
    journal = Journal(home.folder)
    if (home.folder / "journal.json").exists():
        journal.save(replace(journal.load(), floors={}, newest_s=0.0))
