"""Robots that poll a real server, each in a thread, and carry out what they are told."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.client import HTTPException
from typing import Literal

from helpers.polling_robot import PollingRobot

Behaviour = Literal["good", "bad", "stays"]
_POLL_S = 0.5
"""A poll costs the server 5 ms; three robots that poll ten times as often keep a sixth of a processor busy."""


@dataclass
class LivingRobot:
    """A robot that polls until it is stopped.

    A good one installs; a bad one fails after its download; one that stays downloads, and never ends by itself. Each
    gives up an order when it is told to.
    """

    client: PollingRobot
    behaviour: Behaviour
    installed: list[bytes] = field(default_factory=list)
    canceled: list[str] = field(default_factory=list)
    started: list[str] = field(default_factory=list)
    _stop: threading.Event = field(default_factory=threading.Event)

    def live(self) -> None:
        """Polls until it is stopped; a server that does not answer is asked again."""
        while not self._stop.wait(_POLL_S):
            try:
                self._poll()
            except (OSError, HTTPException):  # also an answer that ends in the middle, as its server was killed
                continue

    def stop(self) -> None:
        self._stop.set()

    def _poll(self) -> None:
        links = self.client.links()
        if "cancelAction" in links:
            self._give_up(links["cancelAction"]["href"])
        elif "deploymentBase" in links:
            self._carry_out(links["deploymentBase"]["href"])

    def _give_up(self, address: str) -> None:
        number = json.loads(self.client.get(address))["cancelAction"]["stopId"]
        self.client.say(address, "closed", "success")
        self.canceled.append(number)

    def _carry_out(self, address: str) -> None:
        order = json.loads(self.client.get(address))
        if order["id"] not in self.started:
            self.client.say_of(order, "proceeding", "none", "Installation started")
            self.installed.append(self.client.download(order))
            self.started.append(order["id"])
        if self.behaviour == "good":
            self.client.say_of(order, "proceeding", "none", "Installed Chunk.")
            self.client.say_of(order, "closed", "success", "health ok")
        elif self.behaviour == "bad":
            self.client.say_of(order, "proceeding", "none", "ERROR : the arm does not answer")
            self.client.say_of(order, "closed", "failure", "No suitable .swu image found")


@contextmanager
def living(robots: list[LivingRobot]) -> Iterator[None]:
    """Robots that poll inside the block."""
    threads = [threading.Thread(target=robot.live, name=robot.client.name, daemon=True) for robot in robots]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        for robot in robots:
            robot.stop()
        for thread in threads:
            thread.join()
