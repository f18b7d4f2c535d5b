"""Axes of trials in a simulation: values applied to the compiled model, to sensors and to commands."""
