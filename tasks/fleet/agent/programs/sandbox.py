"""Rights of applications and scripts: a user of their own, and a sandbox where the robot has one.

| sandbox | what it does |
| --- | --- |
| bwrap | the file system is read-only but for the application's data, /tmp and /dev; the agent's token is not there |
| setpriv | no program gets more rights than it has: set-user-id bits and file capabilities count for nothing |
| none | only the user's rights |
"""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import AgentError
from ..settings import Home, Options

KINDS = ("bwrap", "setpriv", "none")
_PROBE_TIMEOUT_S = 20.0


@dataclass(frozen=True)
class Sandbox:
    """How programs are started."""

    kind: str
    home: Home
    rights: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of `subprocess.Popen` that give them their user."""

    user_id: int | None = None

    def wrap(self, command: Sequence[str], data: Path) -> list[str]:
        """The command in the sandbox.

        Args:
            command: the program and its arguments.
            data: the folder that it may write to.
        """
        if self.kind == "setpriv":
            return ["setpriv", "--no-new-privs", "--", *command]
        if self.kind == "bwrap":
            return [*self._bubble(data), "--", *command]
        return list(command)

    def _bubble(self, data: Path) -> list[str]:
        words = ["bwrap", "--ro-bind", "/", "/", "--dev-bind", "/dev", "/dev", "--bind", "/tmp", "/tmp"]  # noqa: S108
        home = str(self.home.folder)
        words += ["--ro-bind", home, home, "--bind", str(data), str(data), "--die-with-parent"]
        for secret in (self.home.connection_file, self.home.folder / "journal.json"):
            if secret.exists():
                words += ["--ro-bind", "/dev/null", str(secret)]
        return words

    def data_folder(self, application: str) -> Path:
        """The folder where an application keeps what outlives its versions; it belongs to its user.

        Raises:
            OSError: it cannot be made.
        """
        folder = self.home.folder / "data" / application
        folder.mkdir(parents=True, exist_ok=True)
        if self.user_id is not None:
            os.chown(folder, self.user_id, -1)
        return folder


def find_sandbox(home: Home, options: Options) -> Sandbox:
    """The sandbox that the options ask for, tried with a program that does nothing.

    Raises:
        AgentError: there is no such user or sandbox, or it does not work here.
    """
    rights, user_id = _rights(options.user)
    if options.sandbox != "auto" and options.sandbox not in KINDS:
        raise AgentError(f"--sandbox: {options.sandbox!r} is not right; auto, {', '.join(KINDS)} are")
    for kind in KINDS if options.sandbox == "auto" else (options.sandbox,):
        sandbox = Sandbox(kind, home, rights, user_id)
        if _works(sandbox):
            return sandbox
    raise AgentError(f"--sandbox {options.sandbox}: it does not work here; auto takes what does")


def _rights(user: str | None) -> tuple[dict[str, Any], int | None]:
    if user is None:
        return {}, None
    try:
        entry = pwd.getpwnam(user)
    except KeyError:
        raise AgentError(f"--user: there is no user {user!r} on this robot") from None
    if os.geteuid() == entry.pw_uid:
        return {}, None
    if os.geteuid() != 0:
        raise AgentError(f"--user {user}: only root can start programs as another user")
    groups = os.getgrouplist(user, entry.pw_gid)
    return {"user": entry.pw_uid, "group": entry.pw_gid, "extra_groups": groups}, entry.pw_uid


def _works(sandbox: Sandbox) -> bool:
    if sandbox.kind == "none":
        return True
    if shutil.which(sandbox.kind) is None:
        return False
    try:
        words = sandbox.wrap(["true"], sandbox.home.logs)
        quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.run(words, check=False, timeout=_PROBE_TIMEOUT_S, **quiet, **sandbox.rights).returncode == 0
    except (OSError, subprocess.SubprocessError):
        return False
