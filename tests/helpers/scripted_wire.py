"""A way to ROS nodes whose nodes are a script, on a clock of its own."""

from collections.abc import Callable, Sequence

from prefect_robomaker.tasks.runtime.ros.wire import Command, Peers, Topic


class ScriptedWire:
    """Commands arrive at times that a test says, or as answers to messages; waiting takes no time but the clock's."""

    name = "ROS 2, domain 7"

    def __init__(
        self,
        commands: Sequence[tuple[float, Command]] = (),
        answer: Callable[[str, float], Sequence[tuple[float, Command]]] = lambda *_: (),
        peers: Callable[[float], Peers] = lambda _: Peers(commanders=1),
    ) -> None:
        """Prepares a script.

        Args:
            commands: Wall-clock times, in seconds, and commands that arrive then.
            answer: Commands that answer a message: given its topic and the time, times and commands.
            peers: The nodes that are there at a time.
        """
        self.now_s = 0.0
        self.sent: list[tuple[float, str, bytes]] = []
        self.opened: list[Topic] = []
        self._coming = sorted(commands, key=lambda each: each[0])
        self._answer, self._peers = answer, peers

    def clock(self) -> float:
        """Wall-clock seconds."""
        return self.now_s

    def open(self, topics: Sequence[Topic], command_topic: str) -> None:
        """See `Wire`."""
        del command_topic
        self.opened = list(topics)

    def send(self, topic: str, message: bytes) -> None:
        """See `Wire`."""
        self.sent.append((self.now_s, topic, message))
        self._coming = sorted([*self._coming, *self._answer(topic, self.now_s)], key=lambda each: each[0])

    def take(self) -> list[Command]:
        """See `Wire`."""
        here = [command for at_s, command in self._coming if at_s <= self.now_s]
        self._coming = self._coming[len(here) :]
        return here

    def wait(self, timeout_s: float) -> bool:
        """See `Wire`."""
        until_s = self.now_s + timeout_s
        if self._coming and self._coming[0][0] <= until_s:
            self.now_s = max(self.now_s, self._coming[0][0])
            return True
        self.now_s = until_s
        return False

    def peers(self) -> Peers:
        """See `Wire`."""
        return self._peers(self.now_s)

    def close(self) -> None:
        """See `Wire`."""
