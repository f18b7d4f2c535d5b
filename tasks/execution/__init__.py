"""Runs stored jobs, each by one worker at a time, and reports flow runs to Prefect: heartbeats, ends, deaths."""
