"""Machine slots: limit of simulation jobs that run here at once, with messages and times of those that wait."""

import logging
import os
import secrets
import threading
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ...schemas.runs.programs import Scarce
from ...schemas.settings import Settings
from .free_memory_and_disk import Need, Room, Wait, available_memory_bytes, free_disk_bytes, why_wait
from .slot_files import WRITE_EVERY_S, Holder, SlotFiles, Slots, WaiterFiles, WaiterRecord, may_begin

_AFTER_S = 2.0
_AGAIN_S = 600.0


class Notices:
    """Decides when a wait for resources of this machine is told to the user: once it lasts, and not too often."""

    def __init__(self) -> None:
        self._scarce: Scarce | None = None
        self._began_s = 0.0
        self._told_s: dict[Scarce, float] = {}
        self.lasting: Scarce | None = None
        """Scarce resource of the current wait, once the wait has lasted two seconds; None: no such wait."""

    def is_due(self, wait: Wait | None, now_s: float) -> bool:
        """Whether to report a wait now: it has lasted two seconds and was not reported in ten minutes.

        A wait that is due counts as reported.

        Args:
            wait: Why there is waiting at this moment; None: there is nothing to tell.
            now_s: Seconds on any clock.
        """
        scarce = wait.scarce if wait else None
        if scarce != self._scarce:
            self._scarce, self._began_s = scarce, now_s
        self.lasting = scarce if now_s - self._began_s >= _AFTER_S else None
        if self.lasting is None:
            return False
        if self.lasting in self._told_s and now_s - self._told_s[self.lasting] < _AGAIN_S:
            return False
        self._told_s[self.lasting] = now_s
        return True


class WaitTimes:
    """Sum, in seconds, of the times that jobs waited for each scarce resource, from samples several times a second."""

    def __init__(self) -> None:
        self._total_s: dict[Scarce, float] = {}
        self._scarce: Scarce | None = None
        self._seen_s = 0.0

    def see(self, scarce: Scarce | None, now_s: float) -> None:
        """Records the resource that is waited for at this moment.

        Args:
            scarce: Resource that is short; None: there is no wait.
            now_s: Seconds on any clock.
        """
        if self._scarce is not None:
            self._total_s[self._scarce] = self._total_s.get(self._scarce, 0.0) + max(0.0, now_s - self._seen_s)
        self._scarce, self._seen_s = scarce, now_s

    def total_s(self, before_s: Mapping[Scarce, float]) -> dict[Scarce, float]:
        """Returns the total waiting time in seconds for each resource.

        Args:
            before_s: The totals of an earlier moment, which are left out.
        """
        return {scarce: total_s - before_s.get(scarce, 0.0) for scarce, total_s in self._total_s.items()}


_FOLDER = "slots"
_WAITERS = "waiting"
_FINISHING = "finishing"
_LOOK_S = 0.1
_GROWS_S = 10.0
"""Time after its start within which a job takes most of the memory that it needs, in seconds."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Turn:
    """A job's right to simulate on this machine (a slot), inside a `with` block, with the time it waited for it."""

    waited_s: Mapping[Scarce, float]
    """Time that the job waited for the slot, in seconds, by scarce resource; waits for its own batch do not count."""


class MachineSlots:
    """Slots of the machine that limit how many simulation jobs run at once, shared fairly by all batches.

    Safe to use from several threads.

    Args:
        settings: Folder and number of the slots, and memory and disk that have to be free before a job begins.
        batch: ARN of the batch; None: the job is in none.
        priority: Priority of the batch; the higher, the earlier its jobs begin.
        tell: Called with a text that jobs wait, and why.
        watch: Called with the reason why jobs wait, after a wait of two seconds, and with None when the wait is over.
        memory: Measures the available memory in bytes; None: not known.
        disk: Measures the free disk of a folder in bytes.
        clock: Seconds since 1970, the same for all processes.
    """

    def __init__(
        self,
        settings: Settings,
        batch: str | None = None,
        priority: int = 0,
        *,
        tell: Callable[[str], None] = lambda _: None,
        watch: Callable[[Scarce | None], None] = lambda _: None,
        memory: Callable[[], int | None] = available_memory_bytes,
        disk: Callable[[Path], int] = free_disk_bytes,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._home = settings.home
        self._need = Need(settings.job_memory_mb * 10**6, settings.min_free_disk_mb * 10**6)
        self._slots = SlotFiles(settings.home / _FOLDER, settings.max_jobs)
        self._finishing = SlotFiles(settings.home / _FOLDER / _FINISHING, settings.max_jobs)
        self._waiters = WaiterFiles(settings.home / _FOLDER / _WAITERS)
        self._batch, self._priority = batch, priority
        self._tell, self._memory, self._disk, self._clock = tell, memory, disk, clock
        self._watch = watch
        self._shown: Scarce | None = None
        self._notices, self._times = Notices(), WaitTimes()
        self._lock, self._front = threading.Lock(), threading.Lock()
        self._ticket = f"{os.getpid()}-{secrets.token_hex(8)}"
        self._since_s: float | None = None
        self._written: tuple[float, str | None] | None = None
        self._threads = 0  # that wait, or will in a moment
        self._kept = 0  # of these, how many will in a moment

    @contextmanager
    def hold(
        self, should_stop: Callable[[], bool], name: str = "a job", wants_more: Callable[[], bool] = lambda: False
    ) -> Generator[Turn | None]:
        """Waits for a slot, which lets one job simulate on this machine, and holds it inside the `with` block.

        Args:
            should_stop: Called while waiting; once true, waiting ends.
            name: Name of the waiting job, for messages.
            wants_more: Asked when the block ends: whether another thread, or this one, wants a slot in a moment. The
                turn is kept for it, so that the slot goes to no batch that comes after this one.

        Yields:
            The slot; None only when `should_stop` ended the wait.
        """
        before_s = self.waited_s()
        slot = self._awaited(should_stop, name)
        try:
            yield None if slot is None else Turn(self.waited_s(before_s))
        finally:
            if slot is not None:
                try:
                    if wants_more():
                        self._keep_turn(name)
                finally:
                    self.give_back(slot)

    def take(self, name: str = "a job") -> int | None:
        """Takes and returns a slot if a job may begin now, else returns `None`; `give_back` has to follow.

        From then on this batch waits for slots, and others with less right to them get none: ask again within seconds,
        or `leave`.

        Args:
            name: Name of the waiting job, for messages.
        """
        with self._lock:
            now_s = self._clock()
            self._since_s = self._since_s or now_s
            slots = self._slots.look()
            wait = self._why_wait(slots, now_s)
            slot = None if wait else self._slots.take(slots.free, Holder(batch=self._batch, began_s=now_s))
            told = wait and self._told(wait, slots)
            self._see(name, told, now_s)
            if wait is not None or self._written is not None:
                self._write(name, told, now_s)
            if slot is not None:
                self._since_s = now_s
            return slot

    def take_finishing(self) -> int | None:
        """Takes and returns one of the extra places for jobs that only render and upload; `None` if none is free.

        There are as many as slots, so a machine has at most twice as many jobs as it has slots. `give_back` frees it.
        """
        holder = Holder(batch=self._batch, began_s=self._clock())
        with self._lock:
            return self._finishing.take(self._finishing.look().free, holder)

    def waited_s(self, since_s: Mapping[Scarce, float] | None = None) -> dict[Scarce, float]:
        """Returns how long jobs have waited until now, in seconds by resource.

        Args:
            since_s: Earlier result of this function, which is subtracted; None: nothing is.
        """
        return self._times.total_s(since_s or {})

    def leave(self) -> None:
        """Stops waiting for slots, so that other batches get them."""
        with self._lock:
            self._leave()

    def _leave(self) -> None:
        if self._written is not None:
            self._waiters.remove(self._ticket)
        self._since_s = self._written = None
        self._see("", None, self._clock())

    def give_back(self, slot: int) -> None:
        """Frees a slot or finishing place, also where a child process has inherited it."""
        self._slots.give_back(slot)

    def _awaited(self, should_stop: Callable[[], bool], name: str) -> int | None:
        """Waits for a slot and returns it, or `None` if `should_stop` says so; one waiting thread polls.

        The batch counts as waiting until the last thread has a slot.
        """
        with self._lock:
            if self._kept:
                self._kept -= 1
            else:
                self._threads += 1
        try:
            while not self._front.acquire(timeout=_LOOK_S):
                if should_stop():
                    return None
            try:
                while (slot := self.take(name)) is None and not should_stop():
                    time.sleep(_LOOK_S)
                return slot
            finally:
                self._front.release()
        finally:
            with self._lock:
                self._threads -= 1
                if self._threads == 0:
                    self._leave()

    def _keep_turn(self, name: str) -> None:
        """Announces that a thread of this batch is about to wait, so that others leave it the slot for some seconds."""
        with self._lock:
            now_s = self._clock()
            self._since_s = self._since_s or now_s
            self._waiters.write(self._ticket, self._record(name, None), now_s)  # a full disk keeps no turn
            self._threads += 1
            self._kept += 1
            self._written = now_s, None

    def _why_wait(self, slots: Slots, now_s: float) -> Wait | None:
        if not slots.free:
            count = len(slots.holders)
            jobs = "1 job runs" if count == 1 else f"{count} jobs run"
            return Wait("slots", f"{jobs} on this machine, as many as ROBOMAKER_MAX_JOBS allows")
        waiters = {**self._waiters.read(now_s), self._ticket: self._record("", None)}
        if not may_begin(self._ticket, waiters, slots.by_batch(), len(slots.free)):
            return Wait("slots", "jobs with a higher priority, or of batches with fewer jobs here, begin first")
        growing = sum(0.0 <= now_s - holder.began_s < _GROWS_S for holder in slots.holders)
        room = Room(self._memory(), self._disk(self._home), len(slots.holders), growing)
        return why_wait(self._need, room)

    def _told(self, wait: Wait, slots: Slots) -> Wait | None:
        """Returns the wait to report; `None` if it is only for other jobs of the same batch, which is normal."""
        only_own = self._batch is not None and all(holder.batch == self._batch for holder in slots.holders)
        return None if wait.scarce == "slots" and only_own else wait

    def _see(self, name: str, wait: Wait | None, now_s: float) -> None:
        """Adds up how long jobs wait, and tells the user once a wait has lasted long enough, or is over.

        Args:
            name: Name of the waiting job, for the text.
            wait: Reason why it waits; `None`: nothing waits.
            now_s: Present time, in seconds since 1970.
        """
        self._times.see(wait and wait.scarce, now_s)
        if self._notices.is_due(wait, now_s) and wait is not None:
            text = f"{name} waits: {wait.text}"
            _logger.log(logging.INFO if wait.scarce == "slots" else logging.WARNING, "%s", text)
            self._tell(text)
        if self._notices.lasting != self._shown:
            self._shown = self._notices.lasting
            self._watch(self._shown)

    def _write(self, name: str, wait: Wait | None, now_s: float) -> None:
        """Writes the record by which other processes see that this batch waits for a slot; not at every call.

        It is written if the last one is old, or has another reason; `None` as the wait: without a reason.
        """
        why = wait.text if wait else None
        if self._written is None or now_s - self._written[0] >= WRITE_EVERY_S or why != self._written[1]:
            self._waiters.write(self._ticket, self._record(name, why), now_s)
            self._written = now_s, why

    def _record(self, name: str, why: str | None) -> WaiterRecord:
        return WaiterRecord(
            pid=os.getpid(),
            name=name,
            batch=self._batch,
            priority=self._priority,
            since_s=self._since_s or 0.0,
            why=why,
        )


def jobs_that_wait(
    settings: Settings, pid: int | None = None, clock: Callable[[], float] = time.time
) -> list[WaiterRecord]:
    """Lists the jobs that wait for resources of this machine, the longest wait first.

    Args:
        settings: Settings of the machine's slots.
        pid: The process that waits; None: any.
        clock: Seconds since 1970.
    """
    found = WaiterFiles(settings.home / _FOLDER / _WAITERS).read(clock()).values()
    waits = (record for record in found if record.why and pid in (None, record.pid))
    return sorted(waits, key=lambda each: each.since_s)
