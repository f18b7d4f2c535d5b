"""Carries out the action of each phase of a deployment; each can be repeated after a power loss at any moment."""

from __future__ import annotations

import hashlib
import subprocess
from collections.abc import Sequence
from typing import Any, Callable, Union

from .bundles.launch_files import is_launch_file
from .child.forking import Child
from .child.phases import carry_out
from .deployment import Version
from .disk import switch, tidy
from .errors import StepFailed, disk_failure
from .programs.application import Application
from .programs.launching import Sandbox, environment, interpreted, script_command
from .programs.work import ChildWork, ScriptWork, Watch
from .settings import Home, Options
from .state_machine import Event, Failed, Passed, Phase, State, kept, wanted

Work = Union[ChildWork, ScriptWork, Watch]
"""Work that runs while the agent polls the server."""

Begun = Union[Work, Sequence[Event]]
"""Running work of a phase, or the events of work that is done already."""


_ROS_HEALTH_S = 10.0
"""Shortest time that a version which ROS launches is watched, in seconds.

A launcher is up for seconds before it says that a package or node is missing.
"""


class Effects:
    """Carries out the actions of each phase of a deployment on the robot.

    Args:
        home: The agent's.
        options: Time-outs, and the health command.
        sandbox: Rights of scripts.
        application: The running application.
        monotonic: A clock that only goes forward, in seconds.
        start: Starts a process; `subprocess.Popen`.
    """

    def __init__(
        self,
        home: Home,
        options: Options,
        sandbox: Sandbox,
        application: Application,
        monotonic: Callable[[], float],
        start: Callable[..., Any] = subprocess.Popen,
    ) -> None:
        self._home = home
        self._options = options
        self._sandbox = sandbox
        self._application = application
        self._monotonic = monotonic
        self._start = start
        self._begin: dict[Phase, Callable[[State], Begun]] = {
            Phase.IDLE: self._tidy,
            Phase.VALIDATING: self._child,
            Phase.CONDITION: self._condition,
            Phase.DOWNLOADING: self._child,
            Phase.PRE_LAUNCH: self._file,
            Phase.LAUNCHING: self._launch,
            Phase.POST_LAUNCH: self._file,
            Phase.WATCHING: self._watch,
            Phase.RETURNING: self._launch,
        }

    def begin(self, state: State) -> Begun:
        """Starts the action of a deployment's current phase on the robot, and returns its work or its events.

        An error of it is the event that the phase failed, and is not raised.
        """
        try:
            return self._begin[state.phase](state)
        except StepFailed as error:
            return [Failed(state.phase, error.code, error.reason)]
        except OSError as error:
            failure = disk_failure(error, f"{state.phase.value} cannot be begun")
            return [Failed(state.phase, failure.code, failure.reason)]

    def restart(self, version: Version | None) -> None:
        """Starts the application version that should run, after its application ended or the agent was started.

        It does nothing if no version should run.

        Raises:
            StepFailed: The application cannot be started.
        """
        switch(self._home, version)
        if version is None:
            self._application.stop()
        else:
            self._application.start(version)

    def _tidy(self, state: State) -> Begun:
        tidy(self._home, kept(state))
        return []

    def _child(self, state: State) -> Begun:
        architecture = self._options.architecture or ""
        return ChildWork(Child(lambda say: carry_out(self._home, state, architecture, say)), state.phase)

    def _condition(self, state: State) -> Begun:
        assert state.deployment is not None
        assert state.deployment.condition is not None
        file = state.deployment.condition
        path = self._home.downloads / file.sha256
        if hashlib.sha256(path.read_bytes()).hexdigest() != file.sha256:
            raise StepFailed("EtagMismatch", f"{path} is not what was downloaded")
        self._home.downloads.chmod(0o755)
        path.chmod(0o755)
        command = interpreted(path)
        return self._script(state, state.deployment.version, command, "the condition file", "DownloadConditionFailed")

    def _file(self, state: State) -> Begun:
        assert state.deployment is not None
        version, name, code = state.deployment.version, "preLaunchFile", "PreLaunchFileFailure"
        file = version.launch.before
        if state.phase is Phase.POST_LAUNCH:
            file, name, code = version.launch.after, "postLaunchFile", "PostLaunchFileFailure"
        if file is None:
            return [Passed(state.phase)]
        command = script_command(self._home.folder / version.folder, file, code)
        return self._script(state, version, command, name, code)

    def _script(self, state: State, version: Version, command: Sequence[str], name: str, code: str) -> ScriptWork:
        data = self._sandbox.data_folder(version.application)
        folder = self._home.folder / version.folder
        log = self._home.logs / f"{state.phase.value}.log"
        with log.open("wb") as output:
            process = self._start(
                self._sandbox.wrap(command, data),
                cwd=folder if folder.is_dir() else data,
                env=environment(self._home, version, data),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                **self._sandbox.rights,
            )
        due_s = self._monotonic() + self._options.script_timeout_s
        return ScriptWork(process, state.phase, name, code, log, due_s, self._monotonic)

    def _launch(self, state: State) -> Begun:
        """Stops the running application, and starts the new version or the last healthy one again, if there is one."""
        version = wanted(state)
        self._application.stop()
        switch(self._home, version)
        if version is not None:
            self._application.start(version)
        return [Passed(state.phase)]

    def _watch(self, state: State) -> Begun:
        assert state.deployment is not None
        version, command = state.deployment.version, self._options.health_command

        def check() -> ScriptWork:
            words = ["/bin/sh", "-c", command or "true"]
            return self._script(state, version, words, "the health command", "RobotDeploymentAborted")

        health_s = self._options.health_s
        if is_launch_file(version.launch.file.split()[0], None):
            health_s = max(health_s, _ROS_HEALTH_S)
        due_s = self._monotonic() + health_s
        return Watch(due_s, self._monotonic, check if command else None)
