"""Sources of chance in a Python process that a rerun holds: randomness, the clock, hashes, and turns of threads.

`robomaker flaky` runs a job again with some of them held, to find the one that decides, and watches which are used. The
file is alone on purpose: it needs nothing but the standard library of Python 3.8, since it is copied into a folder of
the rerun as `sitecustomize.py`, which the Python of any robot program imports before the program's own code. The
process of the simulation calls `hold` instead.

What is held repeats from one process to the next, and is no longer what a program would see in reality: the clock
begins at the year 2000 and goes on with each look at it, so that it counts what the code does, not how long that takes.
"""

# Python 3.8 has neither `X | Y` nor built-in generics at run time; types of what is replaced are not known.
# pyright: reportAttributeAccessIssue=false, reportUnknownMemberType=false, reportPrivateUsage=false

import _thread
import builtins
import datetime
import io
import os
import random
import sys
import sysconfig
import time

HELD_VARIABLE = "ROBOMAKER_HELD"
"""Environment variable that names the held sources, with commas between: `time`, or `time:2` at another value."""
MARK_VARIABLE = "ROBOMAKER_HELD_MARK"
"""Environment variable with the path of a file, to which each process adds what it holds and what it uses."""

_BEGIN_NS = 946_684_800 * 10**9
"""Beginning of the held clock in nanoseconds since 1970: the year 2000."""
_LOOK_NS = 100_000
"""Nanoseconds from one look at the held clock to the next: a budget of milliseconds ends after tens of looks."""
_LATER_NS = 86_400 * 10**9 + 679_013
"""Nanoseconds by which each further value of the clock begins later: another day, and no round number."""
_LONGER_NS = 3_517
"""Nanoseconds by which each look takes longer at each further value of the clock."""
_ROOM_BYTES = (1 << 21) + (1 << 12)
"""Bytes that each further value of hashes takes first: an odd number of pages, and of the 2 MB that a kernel aligns."""
_BEHIND_NS = 5 * 10**9
"""Nanoseconds that the held clock may stay behind the real one; who waits for longer would wait forever."""
_TURN_S = 1.0
"""Seconds that a thread keeps the interpreter, instead of 5 ms; few compute longer without waiting for something."""
_PAUSE_S = 0.002
"""Seconds between two looks at a thread: enough to take the interpreter, if that is all it waits for."""
_CLIENT = os.sep + "agent_client.py"
"""End of the path of this package's robot client, which looks at the clock to end waiting."""
_DRAWS = (
    *("random", "uniform", "gauss", "normalvariate", "choice", "choices", "shuffle", "sample", "randint", "randrange"),
    *("getrandbits", "triangular", "betavariate", "expovariate", "lognormvariate"),
)
"""Functions of the module `random` that draw from its own generator."""
_DEVICES = ("/dev/urandom", "/dev/random")
_DEVICE_BYTES = 4096
"""Bytes that a held device has; programs seed generators with some tens of them."""
_SHARED_FOLDERS = ("/tmp/", "/var/tmp/", "/dev/shm/")
_SOCKET_EVENTS = ("socket.connect", "socket.bind", "socket.sendto")
_FILE_EVENTS = ("open", "os.mkdir", "os.listdir", "os.scandir")
_FIXED_ADDRESSES = 0x0040000
"""ADDR_NO_RANDOMIZE of Linux's `personality`."""
_ASK = 0xFFFFFFFF
_INSTALLED = (os.sep + "site-packages" + os.sep, os.sep + "dist-packages" + os.sep)
"""Folders of installed packages, which may be inside that of the standard library."""


def values_of(words):
    """Returns sources with the numbers of their values, from the text of `HELD_VARIABLE`."""
    parts = [word.partition(":") for word in words.split(",") if word]
    return {source: int(value or 0) for source, _, value in parts}


def hold(sources, seed, outside=()):
    """Holds sources of chance in this process, from now on, and notes which sources the code uses.

    Args:
        sources: Sources with the numbers of their values: `seed`, `time` and `threads`; others are ignored.
        seed: Seed of what replaces the system's randomness.
        outside: Beginnings of paths of source files that go on seeing the real clock; the standard library does.
    """
    code = _Code(("<frozen", *outside))
    notes = _Notes()
    if sys.flags.hash_randomization:
        notes.add("hash")
    _watch_calls(notes, _Turns() if "threads" in sources else None)
    _replace_randomness(seed + (sources["seed"] << 64) if "seed" in sources else None, code, notes)
    clock = _Clock(code, notes, sources.get("time"))
    _replace_functions(clock)
    _replace_dates(clock)
    if "threads" in sources:
        sys.setswitchinterval(_TURN_S)


class _Code:
    """Decides by the path of a source file whether it is code of an application, not of Python or of this package.

    Installed libraries count as the application's.
    """

    def __init__(self, outside):
        self._library = _standard_library()
        self._outside = outside

    def is_of_application(self, file):
        is_of_python = file.startswith(self._library) and not any(folder in file for folder in _INSTALLED)
        return not (is_of_python or file.startswith(self._outside) or file.endswith(_CLIENT))


class _Notes:
    """Sources of chance that were used, each written to the rerun's file at its first use, before a sudden end."""

    def __init__(self):
        self._noted = set()

    def add(self, source):
        if source not in self._noted:
            self._noted.add(source)
            _write("used " + source)


class _Turns:
    """Turns of threads that compute outside Python, where its interpreter gives none.

    A thread begins when all that began before it have ended or wait, or have computed for `_TURN_S` meanwhile.
    """

    def __init__(self):
        self._begun = []
        self._real_sleep, self._now = time.sleep, time.monotonic

    def wait(self):
        """Waits for this thread's first turn."""
        try:
            number = _thread.get_native_id()
            earlier = self._begun[:]
            self._begun.append(number)
            until_s = self._now() + _TURN_S
            for each in earlier:
                while self._computes(each) and self._now() < until_s:
                    pass
        except OSError:
            pass  # without `/proc` nothing is known of other threads

    def _computes(self, thread):
        """Returns whether a thread runs or is ready to, within a pause in which it can have the interpreter."""
        before = self._look(thread)
        self._real_sleep(_PAUSE_S)
        after = self._look(thread)
        return after is not None and (after != before or after[0] not in "SD")

    def _look(self, thread):
        """Returns the state of a thread, and how often it has waited; None: it has ended."""
        try:
            with open("/proc/self/task/{}/status".format(thread)) as file:  # noqa: UP032
                lines = dict(line.split(":", 1) for line in file if ":" in line)
        except (FileNotFoundError, ProcessLookupError):
            return None
        return lines["State"].strip()[0] + lines.get("voluntary_ctxt_switches", "").strip()


def _watch_calls(notes, turns):
    """Notes, from now on, threads, network, names that only one process can have, and files that outlive a program.

    Installs an audit hook, and replaces the functions that start threads.
    """
    kept = (*_SHARED_FOLDERS, os.path.expanduser("~") + os.sep)

    def on_event(event, words):
        if event in ("subprocess.Popen", "os.fork", "os.posix_spawn"):
            notes.add("threads")
        elif event == "socket.getaddrinfo" or (event in _SOCKET_EVENTS and _is_shared(words[1])):
            # An address of its own is what a job beside can take; who only binds one asks no server.
            notes.add("order" if event == "socket.bind" else "network")
        elif event in _FILE_EVENTS and isinstance(words[0], str) and words[0].startswith(kept):
            notes.add("files")

    sys.addaudithook(on_event)
    for name in ("start_new_thread", "start_new", "start_joinable_thread"):
        if hasattr(_thread, name):
            setattr(_thread, name, _noting_threads(getattr(_thread, name), notes, turns))
    threading = sys.modules.get("threading")  # it took the function when it was imported
    if threading is not None and hasattr(threading, "_start_new_thread"):
        threading._start_new_thread = _thread.start_new_thread


def _is_shared(address):
    """Returns whether other jobs see a socket's address: one of the network, or an abstract name."""
    return isinstance(address, tuple) or str(address).startswith(("\0", "b'\\x00"))


def _noting_threads(begin, notes, turns):
    def begin_noted(function, *words, **named):
        notes.add("threads")
        if turns is None:
            return begin(function, *words, **named)

        def in_turn(*own, **own_named):
            turns.wait()
            return function(*own, **own_named)

        return begin(in_turn, *words, **named)

    return begin_noted


def _replace_randomness(seed, code, notes):
    """Replaces the system's randomness by numbers drawn from a seed, also where Python seeds its generators with it.

    Without a seed (`None`) it is only watched. Uses are noted.
    """
    draw, unseeded = random.Random(seed).getrandbits, [0]
    system = os.urandom

    def urandom(size):
        notes.add("seed")
        if seed is None:
            return system(size)
        return draw(8 * size).to_bytes(size, "little") if size else b""

    os.urandom = urandom
    if hasattr(os, "getrandom"):
        os.getrandom = lambda size, _flags=0: urandom(size)
    random._urandom = urandom
    _replace_devices(urandom, seed is not None)
    seeded = random.Random.seed

    def seed_again(self, a=None, version=2):
        if a is None and not isinstance(self, random.SystemRandom):
            if code.is_of_application(sys._getframe(1).f_code.co_filename):
                notes.add("seed")
            if seed is not None:
                unseeded[0] += 1
                a = (seed << 32) + unseeded[0]
        return seeded(self, a, version)

    random.Random.seed = seed_again
    if seed is not None:
        random.seed(seed)
    for name in _DRAWS:
        setattr(random, name, _noting(getattr(random, name), code, notes))


def _replace_devices(urandom, is_held):
    """Replaces `open`, so that files that are the system's randomness give bytes of `urandom` if it is held.

    If it is not held, reading them is only noted.
    """
    real = io.open

    def open_file(file, mode="r", *words, **named):
        if isinstance(file, (str, os.PathLike)) and os.fspath(file) in _DEVICES and "b" in mode:
            drawn = urandom(_DEVICE_BYTES)
            if is_held:
                return io.BytesIO(drawn)
        return real(file, mode, *words, **named)

    io.open = builtins.open = open_file


def _noting(function, code, notes):
    """Returns a function of the module `random` that notes its use."""

    def draw(*words, **named):
        if code.is_of_application(sys._getframe(1).f_code.co_filename):
            notes.add("seed")
        return function(*words, **named)

    return draw


class _Clock:
    """Clock that goes on when it is looked at or slept by, for each source file by itself.

    Each file has a clock of its own, as a library that tries again until it is connected looks as often as it has to.
    """

    def __init__(self, code, notes, value):
        self._code, self._notes, self._is_held = code, notes, value is not None
        self.later_ns = (value or 0) * _LATER_NS
        self._look_ns = _LOOK_NS + (value or 0) * _LONGER_NS
        self._elapsed = {}
        self._real = time.monotonic_ns
        self._real_begin = self._real()

    def read(self, depth=2):
        """Returns nanoseconds since the clock began, which grow with each look; None for code that sees the real clock.

        That is code outside the application, and all code if the clock is not held. A look is noted.
        """
        file = sys._getframe(depth).f_code.co_filename
        if not self._code.is_of_application(file):
            return None
        self._notes.add("time")
        if not self._is_held:
            return None
        elapsed = self._elapsed.get(file, self.later_ns) + self._look_ns
        if self._real() - self._real_begin > elapsed - self.later_ns + _BEHIND_NS:
            elapsed += _BEHIND_NS
        self._elapsed[file] = elapsed
        return elapsed

    def sleep(self, seconds):
        file = sys._getframe(2).f_code.co_filename
        self._elapsed[file] = self._elapsed.get(file, self.later_ns) + int(seconds * 1e9)


def _replace_functions(clock):
    """Replaces the functions of the module `time`, so that the application's code sees the held clock."""

    def held(real, begin_ns, per_unit):
        def look(*which):
            elapsed = clock.read()
            if elapsed is None:
                return real(*which)
            return begin_ns + elapsed if per_unit is None else (begin_ns + elapsed) / per_unit

        return look

    for name, begin_ns in (("time", _BEGIN_NS), ("clock_gettime", _BEGIN_NS), ("monotonic", 0), ("perf_counter", 0)):
        for suffix, per_unit in (("", 1e9), ("_ns", None)):
            setattr(time, name + suffix, held(getattr(time, name + suffix), begin_ns, per_unit))
    for name in ("process_time", "thread_time"):
        for suffix, per_unit in (("", 1e9), ("_ns", None)):
            setattr(time, name + suffix, held(getattr(time, name + suffix), 0, per_unit))
    for name in ("localtime", "gmtime", "ctime"):
        setattr(time, name, _of_now(clock, getattr(time, name)))
    real_sleep = time.sleep

    def sleep(seconds):
        clock.sleep(seconds)
        real_sleep(seconds)

    time.sleep = sleep


def _of_now(clock, real):
    """Returns a function like one of `time` that formats or splits a time; left out, it is the held clock's."""

    def convert(seconds=None):
        elapsed = clock.read() if seconds is None else None
        return real(seconds if elapsed is None else (_BEGIN_NS + elapsed) / 1e9)

    return convert


def _replace_dates(clock):
    """Replaces the classes of the module `datetime` that know what day it is, so that they use the held clock."""
    date, moment = datetime.date, datetime.datetime

    class OfDates(type):
        def __instancecheck__(cls, value):
            return isinstance(value, date)

    class OfMoments(type):
        def __instancecheck__(cls, value):
            return isinstance(value, moment)

    class HeldMoment(moment, metaclass=OfMoments):
        @classmethod
        def now(cls, tz=None):
            elapsed = clock.read()
            return moment.now(tz) if elapsed is None else moment.fromtimestamp((_BEGIN_NS + elapsed) / 1e9, tz)

        @classmethod
        def utcnow(cls):
            elapsed = clock.read()
            utc = moment.now(datetime.timezone.utc)
            if elapsed is not None:
                utc = moment.fromtimestamp((_BEGIN_NS + elapsed) / 1e9, datetime.timezone.utc)
            return utc.replace(tzinfo=None)

        @classmethod
        def today(cls):
            elapsed = clock.read()
            return moment.now() if elapsed is None else moment.fromtimestamp((_BEGIN_NS + elapsed) / 1e9)

    class HeldDate(date, metaclass=OfDates):
        @classmethod
        def today(cls):
            elapsed = clock.read()
            return date.today() if elapsed is None else date.fromtimestamp((_BEGIN_NS + elapsed) / 1e9)

    datetime.datetime, datetime.date = HeldMoment, HeldDate


def _standard_library():
    """Returns beginnings of the paths of Python's own source files, installed packages excepted."""
    return tuple({os.path.join(sysconfig.get_path(name), "") for name in ("stdlib", "platstdlib")})


def hold_as_asked():
    """Holds in this program the sources of chance that its environment variables ask for, and notes them for the rerun.

    Starts the program anew first if its hashes have to be held; does nothing outside of reruns.
    """
    if not os.environ.get(MARK_VARIABLE):
        return
    sources = values_of(os.environ.get(HELD_VARIABLE, ""))
    if "hash" in sources and not _holds_hashes(sources["hash"]):
        del sources["hash"]
    hold(sources, int(os.environ.get("ROBOMAKER_SEED") or 0))
    mark(sources)


def mark(sources):
    """Writes into the file of the rerun which sources of chance this process holds."""
    _write("held " + ",".join(sources))


def _write(line):
    try:
        with open(os.environ.get(MARK_VARIABLE, ""), "a") as file:
            file.write(line + "\n")
    except OSError:
        pass  # what was not said is not counted as held


def _holds_hashes(value):
    """Starts this program anew, with these hashes and addresses, if its own are others, and then does not return.

    Returns true if both are so already. If the program cannot be started anew, returns whether its hashes are so.
    """
    is_fixed = sys.flags.hash_randomization == 0 if value == 0 else os.environ.get("PYTHONHASHSEED") == str(value)
    if is_fixed and not _fix_addresses():
        if value:
            import mmap

            _room.append(mmap.mmap(-1, value * _ROOM_BYTES))
        return True
    words = getattr(sys, "orig_argv", None)  # Python 3.10 and newer
    if not words or not sys.executable:
        return is_fixed
    os.environ["PYTHONHASHSEED"] = str(value)
    try:
        os.execv(sys.executable, [sys.executable, *words[1:]])
    except OSError:
        return is_fixed


_room = []
"""Memory that moves what is asked for later, at another value of hashes and addresses."""


def _fix_addresses():
    """Makes programs that this process executes begin at the same addresses; false if they do already, or cannot."""
    try:
        import ctypes

        change = ctypes.CDLL(None).personality
        change.argtypes, change.restype = [ctypes.c_ulong], ctypes.c_int
        now = change(_ASK)
        return now >= 0 and not now & _FIXED_ADDRESSES and change(now | _FIXED_ADDRESSES) >= 0
    except (ImportError, OSError, AttributeError):
        return False


def _make_room():
    """Imports the `sitecustomize` that this file has hidden, if there is one; else this file stays in its place."""
    here = os.path.dirname(os.path.abspath(__file__))
    kept, own = sys.path[:], sys.modules.pop("sitecustomize")
    sys.path[:] = [entry for entry in kept if os.path.abspath(entry or ".") != here]
    try:
        import sitecustomize  # noqa: F401 # pyright: ignore[reportMissingImports, reportUnusedImport]
    except ImportError:
        pass
    finally:
        sys.path[:] = kept
        sys.modules.setdefault("sitecustomize", own)


if __name__ == "sitecustomize":
    hold_as_asked()
    _make_room()
