"""Axes of trials in a simulation: apply values to the compiled model, to sensors and to commands."""
