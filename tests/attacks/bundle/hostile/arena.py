"""Environments and agents that do something bad in their third step, and then go on."""

import ctypes
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import dm_env
import numpy as np
from dm_env import specs


class Calm(dm_env.Environment):
    """Ends after five steps."""

    def __init__(self, context):
        self.context = context
        self.output = Path(context.output_dir)
        self.count = 0
        note_process()

    def reset(self):
        return dm_env.restart(np.zeros(1))

    def step(self, action):
        self.count += 1
        if self.count == 3:
            self.misbehave()
        make = dm_env.termination if self.count == 5 else dm_env.transition
        return make(0.0, np.zeros(1))

    def misbehave(self):
        pass

    def observation_spec(self):
        return specs.Array((1,), float)

    def action_spec(self):
        return specs.Array((1,), float)


def note_process(pid=None):
    with Path(os.environ["PROCESSES"]).open("a") as notes:
        notes.write(f"{pid or os.getpid()}\n")


def doing(action):
    class Doing(Calm):
        def misbehave(self):
            action(self)

    return Doing


def agent(context, environment):
    return lambda timestep: np.zeros(1)


# Environments and agents of the wrong kind


class NonsenseSpecs(Calm):
    observation_spec = action_spec = lambda self: "three wheels"


class NoTimeStep(Calm):
    def step(self, action):
        return np.zeros(1), 0.0, False, {}


class NoTimeStepAtFirst(Calm):
    def reset(self):
        return None


def nothing(context):
    note_process()


def no_agent(context, environment):
    return "forward!"


def dreaming_agent(context, environment):
    note_process()
    return lambda timestep: np.full(2, np.nan)


def many_armed_agent(context, environment):
    note_process()
    return lambda timestep: np.zeros(17)


class BoastingResult(Calm):
    def run_result(self):
        return {"verdict": "PASS", "summary": "x" * 5_000_000, "extra": {"all": list(range(500_000))}}


class CyclicResult(Calm):
    def run_result(self):
        extra = {}
        extra["self"] = extra
        return {"verdict": "PASS", "extra": extra}


# Bad habits


def _print_megabytes(environment):
    for _ in range(200):
        print("x" * 50_000)
        os.write(2, b"\xff\xfe\x00" * 10_000)


def _never_return(environment):
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    while True:
        time.sleep(1)


def _daemonise(environment):
    """Leaves a daemon as daemons are made: two forks, a session of its own, no ties."""
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            os.chdir("/")
            note_process()
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            time.sleep(600)
        os._exit(0)
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True)
    time.sleep(0.3)


def _change_folder(environment):
    os.chdir("/")


def _exit_quietly(environment):
    (environment.output / "result.json").write_text('{"verdict": "PASS"}')
    os._exit(0)


def _crash(environment):
    ctypes.string_at(0)


def _delete_outputs(environment):
    shutil.rmtree(environment.output)


def _file_for_outputs(environment):
    shutil.rmtree(environment.output)
    environment.output.write_text("no folder")


def _link_to_secret(environment):
    (environment.output / "innocent.txt").symlink_to("/etc/passwd")


def _link_to_folder(environment):
    (environment.output / "everything").symlink_to("/")


def _pipe(environment):
    os.mkfifo(environment.output / "pipe")


def _pipe_for_log(environment):
    log = environment.output / "logs" / "stderr.log"
    log.unlink()
    os.mkfifo(log)
    raise RuntimeError("now read my log")


def _link_for_log(environment):
    log = environment.output / "logs" / "stderr.log"
    log.unlink()
    log.symlink_to("/etc/passwd")
    raise RuntimeError("now read my log")


def _own_manifest(environment):
    (environment.output / "manifest.json").write_text('{"files": []}')


def _strange_names(environment):
    Path(os.fsdecode(os.fsencode(environment.output) + b"/\xff\xfe")).write_text("not UTF-8")


def _deep_folders(environment):
    for folder, depth in ((environment.output, 150), (Path.cwd(), 1500)):
        os.chdir(folder)
        for _ in range(depth):
            Path("d").mkdir()
            os.chdir("d")


def _fill_output(environment):
    """5 MB in 300 files: some time to publish, too much for a small disk."""
    for number in range(300):
        (environment.output / f"{number}.bin").write_bytes(os.urandom(17_000))


def _close_descriptors(environment):
    os.closerange(0, 64)


calm = Calm
printing = doing(_print_megabytes)
endless = doing(_never_return)
daemonising = doing(_daemonise)
wandering = doing(_change_folder)
exiting = doing(_exit_quietly)
crashing = doing(_crash)
deleting = doing(_delete_outputs)
replacing = doing(_file_for_outputs)
linking = doing(_link_to_secret)
linking_folders = doing(_link_to_folder)
piping = doing(_pipe)
piping_log = doing(_pipe_for_log)
linking_log = doing(_link_for_log)
forging = doing(_own_manifest)
naming = doing(_strange_names)
digging = doing(_deep_folders)
filling = doing(_fill_output)
closing = doing(_close_descriptors)
