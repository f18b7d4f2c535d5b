"""The time axis of a rollout's chart, in percent of its width, so that letters keep their size on any screen."""

from dataclasses import dataclass

from .. import wording

_STEPS_S = (
    0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 21600, 43200, 86400, 172800, 432000,
)  # fmt: skip
_MOST_TICKS = 6


@dataclass(frozen=True)
class Scale:
    """From when to when the chart reaches, in seconds since the epoch."""

    from_s: float
    until_s: float

    @property
    def length_s(self) -> float:
        """How long that is; never nothing, so that a rollout that ended at once can be drawn."""
        return max(self.until_s - self.from_s, 0.1)

    def part(self, at_s: float) -> float:
        """Position of a moment, from 0 at the left to 1 at the right."""
        return min(1.0, max(0.0, (at_s - self.from_s) / self.length_s))

    def at(self, at_s: float) -> str:
        """Position of a moment, as a coordinate of SVG, in percent of the width."""
        return percent(self.part(at_s))

    def width(self, from_s: float, until_s: float) -> str:
        """How wide a time is, as a length."""
        return percent(self.part(until_s) - self.part(from_s))

    def ticks(self) -> list[tuple[float, str]]:
        """Round times since the beginning, at most seven: where, from 0 to 1, and in words."""
        step_s = next((step for step in _STEPS_S if self.length_s / step <= _MOST_TICKS), self.length_s / _MOST_TICKS)
        times = [number * step_s for number in range(int(self.length_s / step_s) + 1)]
        return [(min(1.0, time_s / self.length_s), _in_words(time_s)) for time_s in times]


def _in_words(time_s: float) -> str:
    return wording.duration(time_s).replace(".0 s", " s") if time_s else "0"


def percent(part: float) -> str:
    """A part of the width as SVG has it, to a hundredth of a percent."""
    return f"{100 * part:.2f}".rstrip("0").rstrip(".") + "%"
