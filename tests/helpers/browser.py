"""A real browser without a window: opens pages, waits for what they show, takes pictures (DevTools protocol)."""

import base64
import itertools
import json
import shutil
import signal
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from helpers.required_programs import needs

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), ""
)
NEEDS_BROWSER = needs("chromium", CHROMIUM, "no Chromium on this machine: chromium, google-chrome not in PATH")
_PATIENCE_S = 240.0
"""Jobs that pages show run beside other tests, on machines that are busy."""


class Page:
    """One tab.

    Args:
        socket: Its DevTools.

    Attributes:
        complaints: Errors and warnings on the page's console, and exceptions that it did not catch.
    """

    def __init__(self, socket: ClientConnection) -> None:
        self.complaints: list[str] = []
        self._socket = socket
        self._numbers = itertools.count(1)
        for domain in ("Runtime", "Log"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Sends a command of the DevTools protocol and returns its result."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=_PATIENCE_S))
            if message.get("id") == number:
                assert "error" not in message, message["error"]
                return message["result"]
            self._note(message)

    def go(self, url: str) -> None:
        """Begins to load a page, as if its address was typed."""
        self.send("Page.navigate", url=url)

    def load(self, url: str, width: int, height: int = 1000) -> None:
        """Loads a page of a size in CSS pixels; windows themselves have a least width."""
        self.resize(width, height)
        self.go(url)
        self.wait(
            lambda page: (
                page.address.partition("#")[0] == url.partition("#")[0]
                and page.evaluate("document.readyState") == "complete"
            ),
            url,
        )

    def evaluate(self, script: str) -> Any:
        """The value of an expression in the page; promises are waited for."""
        answer = self.send("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    @property
    def text(self) -> str:
        """What the page shows."""
        return self.evaluate("document.body ? document.body.innerText : ''") or ""

    @property
    def address(self) -> str:
        """What the address bar shows."""
        return self.evaluate("location.href")

    def wait(self, probe: Callable[["Page"], Any], what: str) -> Any:
        """Asks until the answer is true, and returns it; pages in between count as no answer.

        The longer that takes, the more seldom: each question has the page laid out.
        """
        began = time.monotonic()
        while True:
            try:
                if answer := probe(self):
                    return answer
            except AssertionError:
                answer = None  # the page is being replaced by another
            waited_s = time.monotonic() - began
            assert waited_s < _PATIENCE_S, f"waited for {what} at {self.address}:\n{self.text}"
            time.sleep(min(0.2 + waited_s / 20, 1.0))

    def wait_for_text(self, *words: str) -> str:
        """Waits until the page shows all words, and returns what it shows."""
        return self.wait(lambda page: (text := page.text) and all(w in text for w in words) and text, repr(words))

    def picture(self, path: Path, width: int | None = None, height: int = 1000) -> Path:
        """Takes a picture of the page in a window of a size; without a size of all of it, as it is."""
        if width is not None:
            self.resize(width, height)
            time.sleep(1.0)  # pages lay themselves out anew
        shot = self.send("Page.captureScreenshot", captureBeyondViewport=width is None)
        path.write_bytes(base64.b64decode(shot["data"]))
        if width is not None:
            self.send("Emulation.clearDeviceMetricsOverride")
        return path

    def resize(self, width: int, height: int = 1000) -> None:
        """Gives the page a size in CSS pixels."""
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def _note(self, event: dict[str, Any]) -> None:
        parameters = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(str(parameters["exceptionDetails"].get("text")))
        elif event.get("method") == "Log.entryAdded" and parameters["entry"]["level"] in ("error", "warning"):
            self.complaints.append(str(parameters["entry"]["text"]))
        elif event.get("method") == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "warning", "assert"):
            said = (str(each.get("value", each.get("description"))) for each in parameters["args"])
            self.complaints.append(" ".join(said))


class Browser:
    """A running browser.

    Args:
        port: Of its DevTools.
    """

    def __init__(self, port: int) -> None:
        self._url = f"127.0.0.1:{port}"

    @contextmanager
    def page(self, url: str = "about:blank", *, beside: Page | None = None) -> Iterator[Page]:
        """A new tab; or a window of its own, which is seen beside that of another page."""
        if beside is not None:
            made = beside.send("Target.createTarget", url="about:blank", newWindow=True)
            address = f"ws://{self._url}/devtools/page/{made['targetId']}"
        else:
            request = urllib.request.Request(f"http://{self._url}/json/new?about:blank", method="PUT")
            with urllib.request.urlopen(request, timeout=_PATIENCE_S) as answer:
                address = json.load(answer)["webSocketDebuggerUrl"]
        socket = connect(address, max_size=None, open_timeout=_PATIENCE_S)
        with closing(socket):
            page = Page(socket)
            page.go(url)
            yield page
            with suppress(ConnectionClosed):
                page.send("Page.close")


@contextmanager
def browsing(profile: Path, *options: str) -> Iterator[Browser]:
    """A browser with an empty profile.

    Args:
        profile: Folder for what it keeps.
        *options: Further options of Chromium.
    """
    command = [
        CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-dev-shm-usage",
        "--no-first-run", "--disable-background-networking", f"--user-data-dir={profile}", "--remote-debugging-port=0",
        "--window-size=1280,1000",
        "--force-prefers-reduced-motion",  # what moves is drawn without a GPU: half a processor while a test waits
        *options, "about:blank",
    ]  # fmt: skip
    profile.mkdir(parents=True, exist_ok=True)
    with (
        (profile / "browser.log").open("wb") as log,
        subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True) as process,
    ):
        try:
            yield Browser(_port(profile, process))
        finally:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()


def _port(profile: Path, process: subprocess.Popen[bytes]) -> int:
    deadline = time.monotonic() + _PATIENCE_S
    while time.monotonic() < deadline and process.poll() is None:
        try:
            return int((profile / "DevToolsActivePort").read_text().splitlines()[0])
        except (OSError, IndexError, ValueError):
            time.sleep(0.1)
    raise AssertionError(f"Chromium did not start: {(profile / 'browser.log').read_text(errors='replace')[-2000:]}")
