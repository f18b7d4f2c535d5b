"""Stored states of a run: state log, checkpoints, state hashes, provenance, failure state."""
