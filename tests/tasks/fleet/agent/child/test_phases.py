"""What a child imports to validate: TUF, without what it fetches by."""

import subprocess
import sys

import pytest

from prefect_robomaker.tasks.fleet.agent.child.phases import Progress

PROGRAM = """
import sys
from types import SimpleNamespace
from prefect_robomaker.tasks.fleet.agent.child import phases
{change}
repository = phases._repository_class()
print(repository.__name__, "tuf.ngclient._internal.proxy" in sys.modules)
"""
NEEDS_MORE = "phases.SimpleNamespace = lambda **_: SimpleNamespace()"


@pytest.mark.parametrize(
    ("change", "is_imported"), [("", False), (NEEDS_MORE, True)], ids=["as it is", "a TUF that needs more"]
)
def test_what_tuf_fetches_by_is_left_out_where_it_can_be(change: str, is_imported: bool) -> None:
    program = PROGRAM.format(change=change)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=240, check=False)

    assert done.stdout.split() == ["Repository", str(is_imported)], done.stderr


def test_progress_is_said_twice_a_second_and_not_with_each_chunk() -> None:
    said: list[int] = []
    times = iter([10.0, 10.1, 10.49, 10.5, 10.6, 11.2])
    progress = Progress(lambda **content: said.append(content["progress"]), lambda: next(times))

    for done in range(6):
        progress(done, 10)

    assert said == [0, 30, 50]
