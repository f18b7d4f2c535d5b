"""The promises of semantic versioning: what 1.x keeps of 1.0.0, recorded as files that tests compare.

`python -m tools.promises` says what differs from the record, `--record` writes it anew, and `--record-home` runs a
small specification and keeps its data home, which later versions have to open. `tests/promises` has the records.
"""
