"""Networks in ONNX files: a sum of products, with inputs and outputs of any name, shape and type."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

Shape = Sequence[int | str]


def write_network(
    path: Path,
    weights: Mapping[str, Any],
    *,
    shapes: Mapping[str, Shape] | None = None,
    output: str = "action",
    more_outputs: Sequence[str] = (),
    kind: int = TensorProto.FLOAT,
) -> Path:
    """Writes a network whose action is the sum over its inputs of `input @ weights`.

    Args:
        path: The file.
        weights: By the name of each input, a matrix from its numbers to those of the action.
        shapes: The shapes of inputs; absent: a batch of any size.
        output: The name of the action.
        more_outputs: The names of further outputs, with the same numbers.
        kind: The type of all its numbers.
    """
    dtype = helper.tensor_dtype_to_np_dtype(kind)
    nodes, constants, inputs, products = [], [], [], []
    for index, (name, matrix) in enumerate(weights.items()):
        values = np.asarray(matrix, dtype)
        shape = (shapes or {}).get(name, ("batch", values.shape[0]))
        inputs.append(helper.make_tensor_value_info(name, kind, shape))
        constants.append(numpy_helper.from_array(values, f"weights{index}"))
        nodes.append(helper.make_node("MatMul", [name, f"weights{index}"], [f"product{index}"]))
        products.append(f"product{index}")
    sizes = {np.asarray(matrix).shape[1] for matrix in weights.values()}
    names = [output, *more_outputs]
    nodes += [helper.make_node("Sum" if len(products) > 1 else "Identity", products, [name]) for name in names]
    is_batch = all(len(each.type.tensor_type.shape.dim) > 1 for each in inputs)
    shape = ("batch", *sizes) if is_batch else tuple(sizes)
    outputs = [helper.make_tensor_value_info(name, kind, shape) for name in names]
    graph = helper.make_graph(nodes, "policy", inputs, outputs, constants)
    # An older form than onnx writes by itself, which older releases of onnxruntime read too.
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=10)
    onnx.save(model, str(path))
    return path
