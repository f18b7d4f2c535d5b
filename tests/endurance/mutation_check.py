"""Mutation check: breaks the product in small places, one at a time, and lists which breaks the tests find.

```sh
python tests/endurance/mutation_check.py --commit 2e911324 --tree ../before -o before.json
python tests/endurance/mutation_check.py --commit 2e911324 -o after.json
python tests/endurance/mutation_check.py --compare before.json after.json
```

A break swaps an operator, changes a constant or a condition, or returns early from a function. Its place is drawn from
the hash of `--commit`, so that everybody gets the same breaks. Each break is in another room (a folder of modules);
rooms with more places are drawn first. `--tree` is a checkout with an environment in `.venv`: one of its files is
broken, the tests of that checkout run, and the file is restored.

For each break the tests that import or drive its module run, the nearest first, suite and deep together, until one
fails or `--limit` seconds are over. `docs/benchmarks.md` has the results.
"""

import argparse
import ast
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

LAYERS = ("schemas", "tasks", "flows", "deployments")
PACKAGE = "prefect_robomaker"
MARKERS = "not benchmark and not endurance"
SWAPS: Mapping[type[ast.AST], tuple[str, str]] = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"),
    ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.And: ("and", "or"),
    ast.Or: ("or", "and"),
}
BROAD = ("journeys", "deployments/cli", "deployments/endpoint", "clients", "attacks", "flows")
"""Folders of tests that drive the whole product; they run last."""
NO_TESTS = 5
"""Exit status of pytest when it chose no test."""


@dataclass(frozen=True)
class Break:
    """One change of one file: the text between two offsets becomes another."""

    path: str
    line: int
    start: int
    end: int
    before: str
    after: str
    kind: str

    def applied(self, text: str, drawn_from: str) -> str | None:
        """Returns a file's text with the change; None: the file has changed, and the place is not in it any more.

        Args:
            text: The file's text.
            drawn_from: Its text at the commit that the break was drawn from.
        """
        begin = drawn_from.rfind("\n", 0, self.start) + 1
        end = drawn_from.find("\n", self.end) + 1 or len(drawn_from)
        around = drawn_from[drawn_from.rfind("\n", 0, max(begin - 1, 0)) + 1 : drawn_from.find("\n", end) + 1 or None]
        for context, first in ((around, drawn_from.index(around)), (drawn_from[begin:end], begin)):
            if context.strip() and text.count(context) == 1:
                start = text.index(context) + self.start - first
                return text[:start] + self.after + text[start + self.end - self.start :]
        return None

    def __str__(self) -> str:
        """The place and the change, in one line."""
        return f"{self.path}:{self.line} {self.kind}: {self.before.strip() or 'nothing'} -> {self.after.strip()}"


@dataclass(frozen=True)
class Outcome:
    """Result of the tests for one break."""

    broken: Break
    found: bool
    by: str
    """The first test that failed, or the reason why there is none."""
    files: int
    """Number of test files that were chosen."""
    took_s: float


# Places


class _Places:
    """Breaks that one file can have.

    Args:
        path: The file, relative to the checkout.
        text: Its contents.
    """

    def __init__(self, path: str, text: str) -> None:
        self._path = path
        self._text = text
        self._line_starts = [0]
        for line in text.splitlines(keepends=True):
            self._line_starts.append(self._line_starts[-1] + len(line))

    def all(self) -> Iterator[Break]:
        """Yields every break."""
        for node in ast.walk(ast.parse(self._text)):
            match node:
                case ast.Compare():
                    yield from self._swap(node.left, node.comparators[0], node.ops[0], "comparison")
                case ast.BinOp():
                    yield from self._swap(node.left, node.right, node.op, "operator")
                case ast.BoolOp():
                    yield from self._swap(node.values[0], node.values[1], node.op, "condition")
                case ast.Constant(value=bool() | int() | float()):
                    yield self._constant(node)
                case ast.FunctionDef() | ast.AsyncFunctionDef():
                    yield from self._early_return(node)
                case _:
                    pass

    def _swap(self, left: ast.expr, right: ast.expr, operator: ast.AST, kind: str) -> Iterator[Break]:
        swap = SWAPS.get(type(operator))
        if swap is None or left.end_lineno is None or left.end_col_offset is None:
            return
        begin = self._offset(left.end_lineno, left.end_col_offset)
        end = self._offset(right.lineno, right.col_offset)
        old = self._text[begin:end]
        if old.count(swap[0]) == 1 and "#" not in old:
            yield Break(self._path, left.end_lineno, begin, end, old, old.replace(*swap), kind)

    def _constant(self, node: ast.Constant) -> Break:
        begin = self._offset(node.lineno, node.col_offset)
        end = self._offset(node.end_lineno or 0, node.end_col_offset or 0)
        value = node.value
        after = repr(not value) if isinstance(value, bool) else repr(value + 1)  # type: ignore[operator]
        return Break(self._path, node.lineno, begin, end, self._text[begin:end], after, "constant")

    def _early_return(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[Break]:
        body = node.body[1:] if ast.get_docstring(node) is not None else node.body
        if len(body) > 1 and (indent := body[0].col_offset):
            begin = self._offset(body[0].lineno, 0)
            yield Break(self._path, body[0].lineno, begin, begin, "", " " * indent + "return None\n", "early return")

    def _offset(self, line: int, column: int) -> int:
        """Returns the index of a character; `ast` counts columns in bytes of UTF-8."""
        begin = self._line_starts[line - 1]
        return begin + len(self._text[begin : self._line_starts[line]].encode()[:column].decode())


def sources(tree: Path, commit: str) -> dict[str, str]:
    """Returns the text of every module of the product at a commit."""
    listed = _git(tree, "ls-tree", "-r", "--name-only", commit).split()
    chosen = [
        name for name in listed if name.endswith(".py") and name.startswith(tuple(f"{layer}/" for layer in LAYERS))
    ]
    return {name: _git(tree, "show", f"{commit}:{name}") for name in chosen if "/specs/" not in name}


def drawn(texts: Mapping[str, str], commit: str, count: int) -> list[Break]:
    """Draws breaks from a commit's hash: one place in each room, rooms with more places first."""
    chance = random.Random(int(hashlib.sha256(commit.encode()).hexdigest(), 16))
    rooms: dict[str, list[Break]] = {}
    for path in sorted(texts):
        rooms.setdefault(path.rpartition("/")[0], []).extend(_Places(path, texts[path]).all())
    found: list[Break] = []
    left = {room: places for room, places in rooms.items() if places}
    while len(found) < count:
        # Sorting by exponential variates is a weighted draw without replacement.
        order = sorted(left, key=lambda room: chance.expovariate(len(left[room])))
        found += [chance.choice(left[room]) for room in order[: count - len(found)]]
    return found


# Tests


def chosen_tests(tree: Path, path: str) -> list[str]:
    """Returns files of tests that import or drive a module, the nearest first."""
    module = ".".join((PACKAGE, *Path(path).with_suffix("").parts)).removesuffix(".__init__")
    texts = {str(file.relative_to(tree)): file.read_text() for file in (tree / "tests").rglob("test_*.py")}
    importing = _importing(tree)
    distance = {module: 0}
    front = [module]
    while front:
        nearer = front
        front = []
        for name in nearer:
            for user in importing.get(name, ()):
                if user not in distance:
                    distance[user] = distance[name] + 1
                    front.append(user)
    mirror = Path("tests") / Path(path).with_name(f"test_{Path(path).stem}.py")
    near: dict[str, float] = {}
    for name, text in texts.items():
        used = [distance[other] for other in _named(text) if other in distance]
        broad = name.startswith(tuple(f"tests/{folder}/" for folder in BROAD))
        if used:
            near[name] = min(used) + 10 * broad
        elif broad:
            near[name] = 100
        if name == str(mirror):
            near[name] = -1
        elif name in near and Path(name).parent == mirror.parent:
            near[name] -= 0.5
    return sorted(near, key=lambda name: (near[name], name))


def _named(text: str) -> set[str]:
    """Returns the product's modules that a test file imports; imported members count as modules, too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith(PACKAGE):
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names if alias.name.startswith(PACKAGE))
    return names


def _importing(tree: Path) -> dict[str, set[str]]:
    """Returns the modules that import a module, by module."""
    users: dict[str, set[str]] = {}
    for layer in LAYERS:
        for file in (tree / layer).rglob("*.py"):
            parts = (PACKAGE, *file.relative_to(tree).with_suffix("").parts)
            package = parts[:-1]
            user = ".".join(parts).removesuffix(".__init__")
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.ImportFrom) and node.level:
                    base = ".".join(
                        [*package[: len(package) - node.level + 1], *([node.module] if node.module else [])]
                    )
                    for name in (base, *(f"{base}.{alias.name}" for alias in node.names)):
                        users.setdefault(name, set()).add(user)
    return users


def tried(tree: Path, broken: Break, drawn_from: str, limit_s: float) -> Outcome:
    """Breaks a file, runs the tests of its module, and restores the file."""
    target = tree / broken.path
    whole = target.read_text() if target.exists() else ""
    if (changed := broken.applied(whole, drawn_from)) is None:
        return Outcome(broken, False, "nothing: the place is gone", 0, 0.0)
    files = chosen_tests(tree, broken.path)
    target.write_text(changed)
    begun = time.monotonic()
    try:
        by = _first_failure(tree, files, limit_s)
    finally:
        target.write_text(whole)
    return Outcome(broken, not by.startswith("nothing"), by, len(files), round(time.monotonic() - begun, 1))


def _first_failure(tree: Path, files: list[str], limit_s: float) -> str:
    options = ["-x", "-q", "-p", "no:randomly", "-n", "0", "-m", MARKERS, "--no-header"]
    command = [str(tree / ".venv" / "bin" / "pytest"), *options, *files]
    environ = {**os.environ, "PATH": f"{tree}/.venv/bin:{os.environ['PATH']}"}
    with subprocess.Popen(
        command,
        cwd=tree,
        env=environ,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as running:
        try:
            printed, _ = running.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(running.pid, signal.SIGINT)  # so that fixtures stop their servers
            try:
                running.communicate(timeout=30)
            except subprocess.TimeoutExpired:
                os.killpg(running.pid, signal.SIGKILL)
            return "nothing failed within the limit"
    if running.returncode in (0, NO_TESTS):
        return "nothing failed"
    named = [line for line in printed.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return named[0][:200] if named else printed.strip()[-200:]


def _git(tree: Path, *words: str) -> str:
    return subprocess.run(["git", *words], cwd=tree, capture_output=True, text=True, check=True).stdout


# The command


def compared(before: Path, after: Path) -> int:
    """Prints which breaks only one of two runs found; returns 1 if the later one found fewer."""
    rows = [{str(Break(**row["broken"])): row for row in json.loads(file.read_text())} for file in (before, after)]
    for name in rows[0]:
        told = [rows[index][name]["by"] if rows[index][name]["found"] else "-" for index in (0, 1)]
        print(f"{name}\n    before: {told[0]}\n    after:  {told[1]}")
    counts = [sum(row["found"] for row in some.values()) for some in rows]
    print(f"found before: {counts[0]} of {len(rows[0])}, after: {counts[1]} of {len(rows[1])}")
    return int(counts[1] < counts[0])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commit", help="breaks are drawn from its hash and its sources")
    parser.add_argument("--tree", type=Path, default=Path(__file__).resolve().parents[2])
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--limit", type=float, default=240, help="seconds for the tests of one break")
    parser.add_argument("--list", action="store_true", help="print the breaks and run nothing")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--compare", type=Path, nargs=2, metavar=("BEFORE", "AFTER"))
    asked = parser.parse_args()
    if asked.compare:
        return compared(*asked.compare)
    tree = asked.tree.resolve()
    commit = _git(tree, "rev-parse", asked.commit or "HEAD").strip()
    texts = sources(tree, commit)
    outcomes: list[Outcome] = []
    if asked.output and asked.output.exists() and not asked.list:  # an interrupted check goes on
        rows = json.loads(asked.output.read_text())
        outcomes = [Outcome(**{**row, "broken": Break(**row["broken"])}) for row in rows]
    for number, broken in enumerate(drawn(texts, commit, asked.count), 1):
        if asked.list:
            print(number, broken)
        if asked.list or number <= len(outcomes):
            continue
        outcomes.append(tried(tree, broken, texts[broken.path], asked.limit))
        last = outcomes[-1]
        print(f"{number:2} {'found' if last.found else 'MISSED'} {last.took_s:6.1f} s  {broken}  {last.by}", flush=True)
        if asked.output:
            asked.output.write_text(json.dumps([asdict(outcome) for outcome in outcomes], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
