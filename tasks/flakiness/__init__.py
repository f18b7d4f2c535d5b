"""Flaky jobs: reruns that hold or free one source of chance after another, and what decides whether a job passes."""
