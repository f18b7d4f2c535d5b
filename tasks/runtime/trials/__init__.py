"""Stored results of a job's trials: the journal, the tally, the table."""
