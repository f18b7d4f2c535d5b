"""Runs of stored jobs, side by side: simulation job, batch, world generation job, world export job, deployment job."""
