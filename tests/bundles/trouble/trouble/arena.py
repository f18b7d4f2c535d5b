"""Simulation applications: an environment that counts, and ways to go wrong."""

import faulthandler
import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import dm_env
import numpy as np
from dm_env import specs

from prefect_robomaker.tasks.runtime.recording.messages import Header, JointState, Time


class Counting(dm_env.Environment):
    """Counts to STEPS, waiting WAIT_S each time."""

    def __init__(self, context):
        self.context = context
        self.limit = int(context.environment.get("STEPS", "20"))
        self.wait_s = float(context.environment.get("WAIT_S", "0"))
        self.count = 0

    def reset(self):
        self.count = 0
        return dm_env.restart(np.zeros(1))

    def step(self, action):
        self.count += 1
        time.sleep(self.wait_s)
        self.during_step()
        make = dm_env.termination if self.count >= self.limit else dm_env.transition
        return make(reward=0.0, observation=np.full(1, self.count))

    def during_step(self):
        pass

    def action_spec(self):
        return specs.Array((1,), float)

    def observation_spec(self):
        return specs.Array((1,), float)

    def control_timestep(self):
        return 0.1


def _say_busy():
    Path("busy.new").write_text(str(os.getpid()))
    Path("busy.new").replace("busy")


def make_environment(context):
    _say_busy()
    return Counting(context)


def _doing(action):
    """An environment factory whose environment does something in its tenth step."""

    class Doing(Counting):
        def during_step(self):
            if self.count == 10:
                action(self)

    return Doing


def _raise(environment):
    raise ValueError("the table is on fire")


def _segfault(environment):
    faulthandler.disable()
    os.kill(os.getpid(), signal.SIGSEGV)


def _diverge(environment):
    from dm_control import mujoco

    physics = mujoco.Physics.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    with physics.check_invalid_state():
        physics.data.qvel[0] = np.nan
        physics.step(3)


class Loose(Counting):
    """Has physics of two joints, one of which breaks."""

    def __init__(self, context):
        from dm_control import mujoco

        super().__init__(context)
        joint = "<joint name='{0}'/><geom size='.1' pos='0 0 .2'/>"
        bodies = "".join(f"<body name='{name}'>{joint.format(name + '_hinge')}</body>" for name in ("base", "wrist"))
        self.physics = mujoco.Physics.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")

    def during_step(self):
        if self.count == 10:
            self.physics.data.qvel[1] = np.nan
        with self.physics.check_invalid_state():
            self.physics.step()


def _fork(environment):
    """Leaves two children, and two grandchildren in sessions of their own; each leaves a file in the work folder."""
    mark = environment.context.environment["MARK"]
    nap = f"import os, pathlib, time; pathlib.Path(f'{{os.getpid()}}.there').touch(); time.sleep(1000)  # {mark}"
    child = "import subprocess, sys; subprocess.Popen([sys.executable, '-c', sys.argv[1]], start_new_session=True)"
    for _ in range(2):
        subprocess.Popen([sys.executable, "-c", f"{child}; {nap}", nap])
    while len(list(Path().glob("*.there"))) < 4:
        time.sleep(0.01)


def _fill_up(environment):
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
    (environment.context.output_dir / "big.bin").write_bytes(bytes(50_000))


def _overfill(environment):
    """Records more than the disk holds."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
    noise = np.random.default_rng(0).random(1_000_000)
    environment.context.recorder.write("/noise", JointState(Header(Time(0, 0), ""), (), noise), 0.0)


def _render(environment):
    """Renders for itself, both ways that there are."""
    import mujoco
    from dm_control.mujoco import Physics

    physics = Physics.from_xml_string("<mujoco><worldbody><geom size='1' rgba='1 0 0 1'/></worldbody></mujoco>")
    renderer = mujoco.Renderer(physics.model.ptr, 48, 64)
    renderer.update_scene(physics.data.ptr)
    pictures = physics.render(48, 64, camera_id=-1), renderer.render()
    renderer.close()
    print([bool(picture.any()) for picture in pictures])


def _print_a_lot(environment):
    for i in range(20_000):
        print(f"line {i} " + "x" * 90)
        print(f"\x1b[31mwarning {i}\x1b[0m", file=sys.stderr)


def _ignore_sigterm(environment):
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    _say_busy()
    while True:
        time.sleep(0.05)


def _hang(environment):
    _say_busy()
    time.sleep(1000)


def _exit_3(environment):
    os._exit(3)


def _exit_0(environment):
    sys.exit(0)


def _write_to_descriptors(environment):
    os.write(1, b"from C, to stdout\n")
    subprocess.run(["sh", "-c", "echo from a program; echo complaint >&2; cat"], check=True)


class NoMessage(Counting):
    def run_result(self):
        return {"verdict": "MAYBE"}


class Judging(Counting):
    def run_result(self):
        return {
            "verdict": "PASS",
            "summary": f"Counted to {self.count}.",
            "requirements": [{"name": "counted", "satisfied": np.bool_(True), "detail": "yes"}],
            "metrics": {"count": np.float32(self.count), "bad": float("nan")},
            "path": [(i * 0.1, float(i), 0.0) for i in range(2000)],
            "extra": {
                "environ": dict(os.environ),
                "cwd": str(Path.cwd()),
                "cores": sorted(os.sched_getaffinity(0)),
                "core_files": resource.getrlimit(resource.RLIMIT_CORE),
                "stdin": sys.stdin.read() if not sys.stdin.closed else None,
                "main": getattr(sys.modules["__main__"], "__file__", ""),
                "random": random.random() + np.random.mtrand.random_sample(),
                "rng": float(self.context.rng.random()),
            },
        }


def _hog(environment):
    environment.hog = [b"x" * (8 << 20) for _ in range(80)]
    time.sleep(1000)


raising = _doing(_raise)
hogging = _doing(_hog)
segfaulting = _doing(_segfault)
diverging = _doing(_diverge)
forking = _doing(_fork)
filling = _doing(_fill_up)
overfilling = _doing(_overfill)
rendering = _doing(_render)
printing = _doing(_print_a_lot)
ignoring_sigterm = _doing(_ignore_sigterm)
hanging = _doing(_hang)
exiting_3 = _doing(_exit_3)
exiting_0 = _doing(_exit_0)
writing = _doing(_write_to_descriptors)
not_callable = 3


class UnableToReset(Counting):
    def reset(self):
        raise RuntimeError("cannot reset")


def unable(context):
    raise KeyError("no such map")


def slow_to_make(context):
    time.sleep(1.2)
    return make_environment(context)


def never_made(context):
    time.sleep(1000)
