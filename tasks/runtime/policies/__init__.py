"""Policies: what maps observations to actions, from Python or ONNX files; and environments to train them in."""
