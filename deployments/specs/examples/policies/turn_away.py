"""A policy in Python: drive on, and turn away from what is near."""


def act(observation):
    """Returns forward velocity in m/s and turning rate in rad/s."""
    ahead = observation["scan"][150:210].min()
    return [0.3, 0.0] if ahead > 0.6 else [0.0, 1.0]
