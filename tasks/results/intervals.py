"""The statistics a report shows."""

import math

_Z_95 = 1.959963984540054  # two-sided 95 % quantile of the normal distribution


def wilson_interval(successes: int, trials: int, quantile: float = _Z_95) -> tuple[float, float]:
    """The Wilson score interval of a success rate, at 95 % confidence unless asked otherwise.

    Chosen over the textbook interval because batches are small and rates near 0 or 1 are common:
    20 passes of 20 give 0.84 to 1, not 1 to 1.

    Args:
        successes: number of successes, 0 to `trials`.
        trials: number of trials, at least 1.
        quantile: two-sided quantile of the normal distribution for the confidence level.

    Returns:
        Lower and upper bound, both in [0, 1].

    Raises:
        ValueError: there are no trials, or more successes than trials.
    """
    if trials < 1 or not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials; want 0 <= successes <= trials and trials >= 1")
    rate = successes / trials
    spread = quantile**2 / trials
    middle = rate + spread / 2
    reach = math.sqrt(spread * (rate * (1 - rate) + spread / 4))
    # At the ends the formula gives exactly 0 and 1; rounding must not push them inside or beyond.
    low = 0.0 if successes == 0 else (middle - reach) / (1 + spread)
    high = 1.0 if successes == trials else (middle + reach) / (1 + spread)
    return low, high
