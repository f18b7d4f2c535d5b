"""A headless Chromium that tests drive over its DevTools socket: pages of any width, scripts, pictures."""

import base64
import contextlib
import itertools
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
from websockets.sync.client import ClientConnection, connect

from helpers.required_programs import needs

EXECUTABLE = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), ""
)
"""Chromium's path; empty where there is none."""

needs_browser = needs("chromium", EXECUTABLE, "no Chromium on this machine: chromium, google-chrome not in PATH")

_START_S = 60.0
_ANSWER_S = 60.0


class Page:
    """One open tab.

    Attributes:
        complaints: What the page wrote to its console as an error or a warning, and exceptions that it did not catch.
    """

    def __init__(self, socket: ClientConnection) -> None:
        self.complaints: list[str] = []
        self._socket = socket
        self._numbers = itertools.count(1)
        for domain in ("Page", "Runtime", "Log"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Sends one command of the DevTools protocol, and returns its result."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while (message := json.loads(self._socket.recv(timeout=_ANSWER_S))).get("id") != number:
            self._note(message)
        if "error" in message:
            raise RuntimeError(f"{method}: {message['error']['message']}")
        return message["result"]

    def resize(self, width: int, height: int) -> None:
        """Makes the page as large as a window or a phone, in CSS pixels; windows themselves have a least width."""
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def open(self, address: str, wait_s: float = _START_S) -> None:
        """Opens an address, and waits until it is loaded."""
        self.send("Page.navigate", url=address)
        here = address.partition("#")[0]
        self.wait(f"document.readyState === 'complete' && location.href.startsWith({json.dumps(here)})", wait_s)

    def run(self, script: str) -> Any:
        """Evaluates an expression, waits for it if it is a promise, and returns its value.

        Raises:
            RuntimeError: it threw.
        """
        answer = self.send("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if problem := answer.get("exceptionDetails"):
            raise RuntimeError(problem.get("exception", {}).get("description") or problem["text"])
        return answer["result"].get("value")

    def wait(self, condition: str, timeout_s: float = _START_S) -> None:
        """Waits until an expression is true.

        Raises:
            TimeoutError: it was not; says what the page shows.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            # While a page gives way to the next there is nothing to ask.
            with contextlib.suppress(RuntimeError):
                if self.run(f"Boolean({condition})"):
                    return
            if time.monotonic() > deadline:
                shown = self.run("document.body ? document.body.innerText.slice(0, 2000) : ''")
                raise TimeoutError(f"{condition} was not true within {timeout_s:g} s; the page shows:\n{shown}")
            time.sleep(0.1)

    def picture(self, path: Path, whole: bool = True) -> Path:
        """Writes a PNG of the page: all of it, or what fits into the window."""
        shot = self.send("Page.captureScreenshot", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(shot["data"]))
        return path

    def _note(self, event: dict[str, Any]) -> None:
        parameters = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(str(parameters["exceptionDetails"].get("text")))
        elif event.get("method") == "Log.entryAdded" and parameters["entry"]["level"] in ("error", "warning"):
            self.complaints.append(str(parameters["entry"]["text"]))


@contextlib.contextmanager
def browser(*options: str) -> Iterator[Page]:
    """Starts a browser with a fresh profile, gives its only page, and ends it.

    Args:
        options: More command line options, such as `--host-resolver-rules=…`.
    """
    with tempfile.TemporaryDirectory(prefix="chromium-", ignore_cleanup_errors=True) as profile:
        command = [
            EXECUTABLE, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
            "--disable-background-networking", "--hide-scrollbars", "--remote-debugging-port=0",
            "--remote-allow-origins=*", f"--user-data-dir={profile}", *options, "about:blank",
        ]  # fmt: skip
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            port = _port(Path(profile) / "DevToolsActivePort", process)
            tabs = httpx.get(f"http://127.0.0.1:{port}/json/list").json()
            address = next(tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page")
            with connect(address, max_size=None) as socket:
                yield Page(socket)
        finally:
            process.terminate()
            process.wait(30)


def _port(file: Path, process: subprocess.Popen[bytes]) -> int:
    deadline = time.monotonic() + _START_S
    while not (file.exists() and file.read_text().strip()):
        if process.poll() is not None or time.monotonic() > deadline:
            raise RuntimeError("Chromium did not start")
        time.sleep(0.05)
    return int(file.read_text().split()[0])
