"""Stored states of a run: state log, checkpoints, digest, provenance, failure state."""
