"""Runs stored jobs: simulation jobs, batches, world generation jobs and world export jobs."""
