"""Stored states of a run: state log, checkpoints, digest, provenance, failure state.

May import: `schemas`, `tasks.runtime.episode`, `tasks.runtime.limits`.
"""

__all__ = [
    "checkpoint_files",
    "checkpoints",
    "digest",
    "failure_state",
    "folder_digests",
    "imported_code",
    "provenance",
    "state_log",
    "state_log_writer",
    "trial_checkpoints",
]
