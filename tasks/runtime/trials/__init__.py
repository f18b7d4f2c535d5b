"""Stored results of a job's trials: journal, summary, and table."""
