"""Reruns of stored runs, and comparison of a rerun with its run."""
