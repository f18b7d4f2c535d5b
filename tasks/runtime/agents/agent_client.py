"""Client of the agent protocol: drives the robot of a simulation job from a process of your own.

```python
from agent_client import connect

with connect() as simulation:
    for step in simulation:
        simulation.act([0.2, 0.0])
```

This one file is all a robot program needs: copy it into a container or a bundle, or import it as
`prefect_robomaker.tasks.runtime.agents.agent_client`. It runs on Python 3.8 and newer with nothing but the standard
library. With numpy installed, observations are arrays; without, they are numbers and (nested) lists.

The protocol is specified in `docs/robot-programs.md`; the constants and `FrameBuffer` below are the simulation's too.
"""

from __future__ import annotations

import json
import os
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import numpy as np
else:
    try:
        import numpy as np
    except ImportError:
        np = None

SOCKET_VARIABLE = "ROBOMAKER_AGENT_SOCKET"
"""The environment variable that holds the path of the simulation's socket."""

PROTOCOL = "robomaker-agent"
VERSION = 1

HELLO, OBSERVATION, ACTION, END, ERROR = 1, 2, 3, 4, 5  # types of messages

HEADER = struct.Struct("<II")
"""Header of every message: number of content bytes, and message type."""

OBSERVATION_HEADER = struct.Struct("<QdddBB6x")
"""Header of an observation: number, simulated time (s), reward, discount, step type, flags. Arrays follow."""

ACTION_HEADER = struct.Struct("<Q")
"""Header of an action: number of the observation that it answers. Arrays follow."""

HAS_REWARD, HAS_DISCOUNT = 1, 2  # flags of an observation

ITEM_FORMATS = {
    "bool": "?", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float16": "e", "float32": "f", "float64": "d",
}  # fmt: skip
"""Item types of arrays, always little-endian, each with its format character in the module `struct`."""

_MAX_MESSAGE_BYTES = 2**31
_RETRY_S = 0.05


class ProtocolError(Exception):
    """Raised when a message between simulation and robot program violates the protocol."""


class SimulationError(Exception):
    """Raised in a robot program when the simulation refused a message, failed, or closed the connection."""


class FrameBuffer:
    """Splits a byte stream into messages; it does no input or output itself."""

    def __init__(self, limits: dict[int, int]) -> None:
        """Creates a buffer; `limits` has the maximum content size in bytes of each allowed message type."""
        self.limits = limits
        self._buffer = bytearray(8192)
        self._start = self._end = 0

    @property
    def pending(self) -> int:
        """Number of received bytes that belong to a message which is not complete yet."""
        return self._end - self._start

    def space(self) -> memoryview:
        """Returns free buffer space to receive bytes into, at least as much as the rest of the next message needs.

        The content that the last `next` returned becomes invalid.
        """
        pending, needed = self.pending, HEADER.size
        if pending >= HEADER.size:
            needed += self._header()[0]
        if pending == 0:
            self._start = self._end = 0
        elif self._start + needed > len(self._buffer) or self._end == len(self._buffer):
            old = memoryview(self._buffer)[self._start : self._end]
            # A new one even where the old would do: what `next` returned may still be looked at.
            self._buffer = bytearray(max(len(self._buffer), needed))
            self._buffer[:pending] = old
            self._start, self._end = 0, pending
        return memoryview(self._buffer)[self._end :]

    def received(self, count: int) -> None:
        """Counts bytes that were received into the buffer's free space as content of messages."""
        self._end += count

    def next(self) -> tuple[int, memoryview] | None:
        """Returns type and content of the next message; `None` while it has not arrived completely.

        Raises:
            ProtocolError: The message has an unknown type or is longer than messages of its type can be.
        """
        if self.pending < HEADER.size:
            return None
        length, kind = self._header()
        begin = self._start + HEADER.size
        if self._end < begin + length:
            return None
        self._start = begin + length
        return kind, memoryview(self._buffer)[begin : begin + length]

    def _header(self) -> tuple[int, int]:
        length, kind = HEADER.unpack_from(self._buffer, self._start)
        if kind not in self.limits:
            known = ", ".join(map(str, sorted(self.limits)))
            raise ProtocolError(f"a message has type {kind}; it has to be one of {known}")
        if length > self.limits[kind]:
            raise ProtocolError(
                f"a message of type {kind} has {length} bytes; there may be {self.limits[kind]} at most"
            )
        return length, kind


def json_message(kind: int, content: dict[str, Any]) -> bytes:
    """Encodes a JSON message of the agent protocol: header, then ASCII without blanks, members in their given order.

    Raises ValueError if the content has a number that is not finite.
    """
    payload = json.dumps(content, separators=(",", ":"), allow_nan=False).encode("ascii")
    return HEADER.pack(len(payload), kind) + payload


class ArraySpec:
    """Description of one array of an observation or action: path, type, shape and bounds."""

    def __init__(self, description: dict[str, Any]) -> None:
        """Reads the simulation's description of an array: its path, type, shape, place in a message, and bounds.

        Bounds are NumPy arrays if NumPy is installed.
        """
        self.path: tuple[str | int, ...] = tuple(description["path"])
        """Keys and indices that lead to the array in nested observations; empty when the observation is this array."""
        self.name: str = description.get("description", "")
        """Description of the array by the environment; empty if there is none."""
        self.dtype: str = description["dtype"]
        """Type of the items: `float64`, `bool`, …, a key of `ITEM_FORMATS`."""
        self.shape: tuple[int, ...] = tuple(description["shape"])
        """Length of each dimension; empty for a single number."""
        self.offset: int = description["offset"]
        """Byte offset of the array in a message's content."""
        self.minimum: Any = description.get("minimum")
        """Smallest value: a number for all items, or a list in C order; None if there is no bound."""
        self.maximum: Any = description.get("maximum")
        """Largest value: a number for all items, or a list in C order; None if there is no bound."""
        self.count = 1
        for length in self.shape:
            self.count *= length
        self._items = struct.Struct(f"<{self.count}{ITEM_FORMATS[self.dtype]}")
        if np is not None:
            self._numpy_dtype = np.dtype(self.dtype).newbyteorder("<")
            self.minimum = self._numpy_bound(self.minimum, -np.inf)
            self.maximum = self._numpy_bound(self.maximum, np.inf)

    def read(self, data: bytearray) -> Any:
        """Returns one array of an observation from a message's content: a NumPy array, nested lists without NumPy."""
        if np is not None:
            return np.ndarray(self.shape, self._numpy_dtype, data, self.offset)
        return _shaped(iter(self._items.unpack_from(data, self.offset)), self.shape)

    def write(self, value: Any, data: bytearray) -> None:
        """Writes a value into a message's content as this array.

        Raises:
            ValueError: The value has another shape, or is not a number of this type.
        """
        if np is not None:
            array = np.asarray(value)
            if array.shape != self.shape:
                raise ValueError(f"{self}: the value has shape {list(array.shape)}")
            np.ndarray(self.shape, self._numpy_dtype, data, self.offset)[...] = array
            return
        flat = [value]
        try:
            for length in self.shape:
                if any(len(item) != length for item in flat):
                    raise TypeError("the value has another shape")
                flat = [item for items in flat for item in items]
            self._items.pack_into(data, self.offset, *flat)
        except (TypeError, struct.error) as error:
            raise ValueError(f"{self}: {error}") from error

    def _numpy_bound(self, bound: Any, unbounded: float) -> Any:
        """Returns a bound of an array as dm_env has it: one number, or one for each item; None without a bound."""
        if bound is None:
            return None
        if isinstance(bound, list):
            values = [unbounded if item is None else item for item in bound]
            return np.array(values, None if None in bound else self._numpy_dtype).reshape(self.shape)
        return np.array(bound, self._numpy_dtype)

    def __repr__(self) -> str:
        where = "/".join(map(str, self.path)) or "array"
        return f"{where} ({self.dtype}{list(self.shape)})"


def _shaped(items: Iterator[Any], shape: tuple[int, ...]) -> Any:
    return [_shaped(items, shape[1:]) for _ in range(shape[0])] if shape else next(items)


class _Layout:
    """Arrays of an observation or of the action, and their place in a message of the agent protocol."""

    def __init__(self, description: dict[str, Any]) -> None:
        self.size: int = description["size"]
        self.arrays = [ArraySpec(array) for array in description["arrays"]]
        self._flat = all(len(array.path) == 1 for array in self.arrays)

    def specs(self) -> Any:
        return _nested([(array.path, array) for array in self.arrays])

    def read(self, data: bytearray) -> Any:
        if self._flat:  # the usual case, quickly
            return {array.path[0]: array.read(data) for array in self.arrays}
        return _nested([(array.path, array.read(data)) for array in self.arrays])

    def write(self, value: Any, data: bytearray) -> None:
        for array in self.arrays:
            item = value
            for key in array.path:
                item = item[key]
            array.write(item, data)


def _nested(items: list[tuple[tuple[str | int, ...], Any]]) -> Any:
    """Builds nested dictionaries from values and their paths (keys and indices); an empty path gives the value."""
    root: dict[str | int, Any] = {}
    for path, value in items:
        if not path:
            return value
        place = root
        for key in path[:-1]:
            place = place.setdefault(key, {})
        place[path[-1]] = value
    return root


class TimeStep(NamedTuple):
    """An observation of the simulation with its step number; the first four members are as in `dm_env.TimeStep`."""

    step_type: int  # 0 for the first, 1 for others
    reward: float | None
    discount: float | None
    observation: Any
    """Observation: an array, or several arrays by name or by index."""
    step: int
    """Number of the observation, from 0; gaps show how many this program missed."""
    time_s: float
    """Simulated time in seconds; NaN when the environment has no clock."""

    def first(self) -> bool:
        """Whether this is the first time step of the run."""
        return self.step_type == 0

    def last(self) -> bool:
        """Whether the run is over; always false, as a robot program gets no time step after the end."""
        return self.step_type == 2


class Simulation:
    """Connection from a robot program to its simulation; `connect` makes it.

    Iterating gives time steps until the run is over. Leaving a `with` block ends the run; an exception fails it.
    """

    def __init__(self, connection: socket.socket, options: dict[str, Any]) -> None:
        """Does the handshake with the simulation over a connected socket.

        Raises:
            SimulationError: The simulation refused the robot; the message has its reason.
        """
        self._socket = connection
        limit = _MAX_MESSAGE_BYTES
        self._frames = FrameBuffer({HELLO: limit, OBSERVATION: limit, END: limit, ERROR: limit})
        self.mode: str = options["mode"]
        self.ended_by: str | None = None
        """Cause of the run's end, once it is over: `environment`, `canceled`, `duration limit`, …"""
        kind, payload = self._receive()
        hello = json.loads(bytes(payload))
        if kind != HELLO or hello.get("protocol") != PROTOCOL:
            raise ProtocolError("the other side does not speak the agent protocol")
        self.hello: dict[str, Any] = hello
        """Greeting of the simulation: `job_id`, `run_id`, `seed`, `world_dir`, `control_timestep_s`, …"""
        self._observation = _Layout(hello["observation"])
        self._action = _Layout(hello["action"])
        self._message = bytearray(HEADER.size + self._action.size)
        HEADER.pack_into(self._message, 0, self._action.size, ACTION)
        self._content = bytearray(self._action.size)
        self._step = -1
        self._send(json_message(HELLO, {"version": VERSION, **options}))

    def action_spec(self) -> Any:
        """Returns the layout of the robot's actions: an `ArraySpec`, or several by name."""
        return self._action.specs()

    def observation_spec(self) -> Any:
        """Returns the layout of observations: an `ArraySpec`, or several by name."""
        return self._observation.specs()

    def receive(self) -> TimeStep | None:
        """Waits for the next time step (in free mode the newest one); returns `None` when the run is over.

        Raises:
            SimulationError: The simulation refused the last action, failed, or is gone.
        """
        if self.ended_by is not None:
            return None
        message: tuple[int, memoryview] | None = self._receive()
        data = bytearray()
        while message is not None:
            kind, payload = message
            if kind == END:
                self._note_end(payload)
                return None
            if kind != OBSERVATION or len(payload) != self._observation.size:
                raise ProtocolError(f"a message of type {kind} with {len(payload)} bytes is no observation")
            data = bytearray(payload)
            message = self._receive_waiting() if self.mode == "free" else None
        self._step, time_s, reward, discount, step_type, flags = OBSERVATION_HEADER.unpack_from(data)
        return TimeStep(
            step_type,
            reward if flags & HAS_REWARD else None,
            discount if flags & HAS_DISCOUNT else None,
            self._observation.read(data),
            self._step,
            time_s,
        )

    def act(self, action: Any) -> None:
        """Sends an action to the simulation, in lock-step mode one for each observation.

        Does nothing once the run is over.

        Args:
            action: In the form of `action_spec`: an array or list, or several by name.

        Raises:
            ValueError: The action does not have the form that the simulation announced, or no observation was received
                yet.
            SimulationError: The simulation is gone.
        """
        if self.ended_by is not None:
            return  # in free mode this is no mistake
        if self._step < 0:
            raise ValueError("an action answers an observation, and none was received yet")
        ACTION_HEADER.pack_into(self._content, 0, self._step)
        self._action.write(action, self._content)
        self._message[HEADER.size :] = self._content
        self._send(self._message)

    def run(self, agent: Callable[[TimeStep], Any]) -> None:
        """Calls `agent(time_step)` for every observation and sends its action, until the run is over.

        Such a function is what robot applications are that run in the job's process.
        """
        for step in self:
            try:
                action = agent(step)
            except StopIteration:
                self.end()
                return
            self.act(action)

    def end(self) -> None:
        """Tells the simulation that the robot is done, which ends the run normally; does nothing after the end."""
        if self.ended_by is None:
            self.ended_by = "agent"
            self._say(END, {})

    def fail(self, error: str) -> None:
        """Tells the simulation that the robot cannot continue, which fails the job with this reason.

        Does nothing after the end.
        """
        if self.ended_by is None:
            self.ended_by = "failed"
            self._say(ERROR, {"error": error})

    def close(self) -> None:
        """Closes the robot program's connection to the simulation."""
        self._socket.close()

    def __iter__(self) -> Iterator[TimeStep]:
        step = self.receive()
        while step is not None:
            yield step
            step = self.receive()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if error is None:
            self.end()
        elif not isinstance(error, (SimulationError, ProtocolError)):
            self.fail(f"{type(error).__name__}: {error}")
        self.close()

    def _note_end(self, payload: memoryview) -> None:
        self.ended_by = json.loads(bytes(payload))["ended_by"]

    def _say(self, kind: int, content: dict[str, Any]) -> None:
        with suppress(OSError):  # the simulation has closed the connection
            self._socket.sendall(json_message(kind, content))

    def _send(self, message: bytes | bytearray) -> None:
        try:
            self._socket.sendall(message)
        except (BrokenPipeError, ConnectionResetError):
            # Why it has gone is in what it sent last.
            kind, payload = self._receive()
            while kind != END:
                kind, payload = self._receive()
            self._note_end(payload)

    def _receive(self) -> tuple[int, memoryview]:
        while True:
            message = self._frames.next()
            if message is not None:
                return self._checked(message)
            self._fill(0)

    def _receive_waiting(self) -> tuple[int, memoryview] | None:
        """Returns the next message from the simulation if it has already arrived, else `None`; never waits."""
        message = self._frames.next()
        while message is None:
            try:
                self._fill(socket.MSG_DONTWAIT)
            except BlockingIOError:
                return None
            message = self._frames.next()
        return self._checked(message)

    def _fill(self, flags: int) -> None:
        try:
            count = self._socket.recv_into(self._frames.space(), 0, flags)
        except ConnectionResetError:
            count = 0
        if count == 0:
            raise SimulationError("the simulation closed the connection without a word: it failed or was killed")
        self._frames.received(count)

    def _checked(self, message: tuple[int, memoryview]) -> tuple[int, memoryview]:
        if message[0] == ERROR:
            raise SimulationError(json.loads(bytes(message[1]))["error"])
        return message


def connect(
    path: str | None = None,
    mode: str = "lockstep",
    *,
    timeout_s: float = 30.0,
    real_time_factor: float = 1.0,
    connect_timeout_s: float = 30.0,
) -> Simulation:
    """Connects a robot program to its simulation, and returns the connection once both have greeted.

    Waits until the simulation listens.

    Args:
        path: Path of the simulation's Unix socket; default: the environment variable `ROBOMAKER_AGENT_SOCKET`.
        mode: `lockstep`: the simulation waits for an action after each observation. `free`: after the first action the
            simulation runs in real time, repeats the last action, and takes new ones as they arrive.
        timeout_s: Time limit for answering an observation (in free mode: the first one), after which the job fails.
        real_time_factor: In free mode, simulated seconds per second.
        connect_timeout_s: Time limit for connecting, if the simulation does not listen yet.

    Raises:
        SimulationError: The simulation does not listen, or refused.
    """
    path = path or os.environ.get(SOCKET_VARIABLE)
    if not path:
        raise SimulationError(
            f"{SOCKET_VARIABLE} is not set; it is in programs that a simulation job starts as its robot application"
        )
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    deadline_s = time.monotonic() + connect_timeout_s
    while True:
        try:
            connection.connect(path)
            break
        except (FileNotFoundError, ConnectionRefusedError, NotADirectoryError) as error:
            if time.monotonic() >= deadline_s:
                connection.close()
                raise SimulationError(f"no simulation listens at {path} after {connect_timeout_s:g} s") from error
            time.sleep(_RETRY_S)
    options: dict[str, Any] = {"mode": mode, "timeout_s": timeout_s}
    if mode == "free":
        options["real_time_factor"] = real_time_factor
    try:
        return Simulation(connection, options)
    except BaseException:
        connection.close()
        raise
