"""Asks another library, mtl, for the robustness of 1,000 random formulas; run by hand.

    python tests/schemas/runs/record_formulas.py | PYTHON-WITH-metric-temporal-logic \\
        tests/schemas/runs/record_formulas.py mtl > tests/schemas/runs/formula_robustness.txt

`test_formulas.py` compares the product with what was recorded: by metric-temporal-logic 0.4.1, which needs an older
attrs than the tests have, so that it is no dependency. It takes samples for values that hold until the next one, and
the last for one that holds for ever.
"""

import json
import random
import sys
from pathlib import Path

COUNT = 1000


def draw() -> None:
    """Prints formulas in mtl's language, in whole samples, with a signal for each comparison."""
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from helpers.random_formulas import PERIOD_S, random_formula, random_samples

    from prefect_robomaker.schemas.runs.formulas import Comparison, Formula, Join, Number

    for seed in range(COUNT):
        dice = random.Random(seed)
        formula, samples = random_formula(dice, bounded_until=False), random_samples(dice)
        signals: dict[str, list[float]] = {}

        def text(node: Formula) -> str:
            if isinstance(node, Comparison):
                assert isinstance(node.left, Number)
                assert isinstance(node.right, Number)
                name = f"p{len(signals)}"  # noqa: B023 - called at once
                apart = [float(node.right.value) - each for each in samples[str(node.left.value)]]  # noqa: B023
                signals[name] = apart if node.sign in ("<", "<=") else [-each for each in apart]  # noqa: B023
                return name
            parts = [text(part) for part in node.parts]
            if isinstance(node, Join):
                signs = {"and": "&", "or": "|", "->": "->"}
                return f"~{parts[0]}" if node.word == "not" else f"({parts[0]} {signs[node.word]} {parts[1]})"
            if node.word == "until":
                return f"({parts[0]} U {parts[1]})"
            sign = {"always": "G", "eventually": "F"}[node.word]
            if node.bounds is None:
                return f"{sign}{parts[0]}"
            first, last = (round(end / PERIOD_S) for end in node.bounds)
            return f"{sign}[{first},{last + 1}]{parts[0]}"  # mtl leaves out the last moment

        print(json.dumps({"formula": text(formula), "signals": signals}))


def ask() -> None:
    """Prints the robustness that mtl finds for formulas of standard input."""
    import mtl  # pyright: ignore[reportMissingImports] - installed only where the file is recorded

    for line in sys.stdin:
        asked = json.loads(line)
        data = {name: list(enumerate(values)) for name, values in asked["signals"].items()}
        print(round(float(mtl.parse(asked["formula"])(data, dt=1, time=0, quantitative=True)), 9))


if __name__ == "__main__":
    ask() if sys.argv[1:] == ["mtl"] else draw()
