"""Policies (functions from observations to actions) from Python or ONNX files, and environments to train them in."""
