"""Axis over values of an environment variable that applications read."""

from collections.abc import Sequence
from typing import Literal, Self

from pydantic import Field, model_validator

from .kind import Axis, AxisTexts

_MAX_CHARACTERS = 1024
"""Maximum length of a value, as for all launch variables."""


class VariableAxis(Axis):
    """Values of the environment variable with the axis's name; they replace a launch variable of that name."""

    varies = "the environment variable of that name, for both applications; values are text"
    applies_to = "all applications that are factories"
    is_number = False

    kind: Literal["variable"] = Field(description="`variable`.")
    values: AxisTexts = Field(description="Its values, texts; all or some of them are taken.")

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        for value in self.values:
            self.parse(value)
        return self

    @property
    def listed(self) -> Sequence[str]:
        """Values of the environment variable that the axis lists."""
        return self.values

    def parse(self, text: str) -> str:
        """Returns the text itself, after a check.

        Raises:
            ValueError: An environment variable cannot have the text as its value.
        """
        if "\0" in text:
            raise ValueError("no variable can hold a NUL character; remove it")
        if not 1 <= len(text) <= _MAX_CHARACTERS:
            raise ValueError(f"a value has 1 to {_MAX_CHARACTERS} characters, and one has {len(text)}")
        return text

    def at(self, share: float) -> str:
        """Returns the value at a quantile, 0 to 1; all values are equally likely."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
