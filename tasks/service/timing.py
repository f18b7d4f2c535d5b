"""How long a service waits for what; tests pass shorter times."""

from dataclasses import dataclass

from ...schemas.settings import DEFAULT_STORE_PATIENCE_MIN


@dataclass(frozen=True)
class Timing:
    """Times in seconds."""

    lease_s: float = 30.0
    """How long after its last sign of life a job worker counts as dead."""

    renew_lease_every_s: float = 5.0
    """How often the holder of a lease renews it."""

    fleet_patience_s: float = 10.0
    """How long a change of a fleet waits for the changes of others."""

    upload_every_s: float = 5.0
    """How often a job with rolling uploads looks for finished files."""

    store_pause_s: float = 1.0
    """How long after a store did not answer it is asked again; longer and longer, see `patience.py`."""

    store_patience_s: float = 60.0 * DEFAULT_STORE_PATIENCE_MIN
    """How long a job waits for a store that does not answer."""

    store_grace_s: float = 15.0
    """The same for what is stored of a job that was told to stop before."""

    after_kill_s: float = 1.0
    """How long after a run was killed from outside it is tried again: memory may be short just now."""

    after_outage_s: float = 1.0
    """How long after the catalog did not answer it is asked again."""

    longest_retry_pause_s: float = 60.0
    """The longest pause before a job is tried again whose flow run raised."""
