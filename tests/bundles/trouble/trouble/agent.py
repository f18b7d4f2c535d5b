"""Robot applications: one that does its work, and ways to go wrong."""

import os
import signal


def make_agent(context, environment):
    return lambda timestep: 0.0


def leaving_early(context, environment):
    def agent(timestep):
        if timestep.observation[0] >= 5:
            raise StopIteration
        return 0.0

    return agent


def raising(context, environment):
    def agent(timestep):
        if timestep.observation[0] >= 9:
            raise ZeroDivisionError("lost the map")
        return 0.0

    return agent


def killed(context, environment):
    def agent(timestep):
        if timestep.observation[0] >= 9:
            os.kill(os.getpid(), signal.SIGKILL)
        return 0.0

    return agent


def unable(context, environment):
    raise RuntimeError("no wheels")
