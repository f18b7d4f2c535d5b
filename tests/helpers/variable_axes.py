"""Axes of trials that are environment variables, as requests and as trials."""

from collections.abc import Mapping, Sequence
from typing import Any

from prefect_robomaker.schemas.runs.trials import Trials


def variables(values: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """Axes of a request that are environment variables with values."""
    return {name: {"kind": "variable", "values": list(texts)} for name, texts in values.items()}


def trials_of_variables(seeds: int, values: Mapping[str, Sequence[str]] | None = None, **members: Any) -> Trials:
    """Trials of every combination of values of variables."""
    axes = {"axes": variables(values)} if values else {}
    return Trials.model_validate({"seeds": seeds, **axes, **members})
