"""Trains a policy by random search in an environment of gymnasium, and writes it as an ONNX file.

    python train.py WORLD turn_away.onnx [TRIES]

WORLD is the ARN of a world, or the folder of its bundle. Needs `prefect-robomaker[gymnasium]` and `onnx`.
"""

import sys

import numpy as np
import onnx
from onnx import helper, numpy_helper

from prefect_robomaker import robot_env


def rewarded(env, weights, seed):
    """Runs an episode with a policy; returns its rewards and the distance driven in metres."""
    observation, _ = env.reset(seed=seed)
    rewards, is_over = 0.0, False
    while not is_over:
        near = np.minimum(observation["proximity"], 1.0)
        observation, reward, terminated, truncated, info = env.step(near @ weights + [0.1, 0.0])
        rewards, is_over = rewards + reward, terminated or truncated
    return rewards + info["metrics"]["distance_m"]


def network(weights):
    """Converts the policy to an ONNX network."""
    graph = helper.make_graph(
        [
            helper.make_node("Min", ["proximity", "limit"], ["near"]),
            helper.make_node("MatMul", ["near", "weights"], ["turned"]),
            helper.make_node("Add", ["turned", "forward"], ["action"]),
        ],
        "turn_away",
        [helper.make_tensor_value_info("proximity", onnx.TensorProto.FLOAT, ("batch", 15))],
        [helper.make_tensor_value_info("action", onnx.TensorProto.FLOAT, ("batch", 2))],
        [
            numpy_helper.from_array(np.float32(1.0), "limit"),
            numpy_helper.from_array(weights.astype(np.float32), "weights"),
            numpy_helper.from_array(np.array([0.1, 0.0], np.float32), "forward"),
        ],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=10)


def main(world, file, tries="20"):
    """Tries random policies, and saves the best as ONNX file."""
    env = robot_env(world, time_limit_s=10.0)
    rng = np.random.default_rng(0)
    guesses = [rng.normal(0.0, 0.3, (15, 2)) for _ in range(int(tries))]
    best = max(guesses, key=lambda weights: rewarded(env, weights, seed=1))
    onnx.save(network(best), file)


if __name__ == "__main__":
    main(*sys.argv[1:])
