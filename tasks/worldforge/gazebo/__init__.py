"""Worlds in Gazebo's format become worlds like ours: shapes that collide, model, map, proofs and bundle."""
