"""The robot application: pushes the cart under the falling pole."""

import numpy as np

GAINS = np.array([1.0, 40.0, 2.0, 8.0]) / 10.0
"""Newtons per metre, radian and their rates, for an actuator of 10 N."""


def make_agent(context, environment):
    """Makes a linear controller for the cart-pole; the variable GAIN scales it."""
    gains = GAINS * float(context.environment.get("GAIN", "1"))
    spec = environment.action_spec()

    def agent(timestep):
        state = np.concatenate([timestep.observation["position"], timestep.observation["velocity"]])
        return np.clip([gains @ state], spec.minimum, spec.maximum)

    return agent
