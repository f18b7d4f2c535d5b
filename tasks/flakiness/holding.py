"""Holding of factors in a rerun: what its processes find on this machine, and what they say they hold and use.

The job's request, its application and its plan stay what they were; only the request that starts the processes is
another one. Randomness, clock and hashes are held inside Python programs (`held_sources`); programs in other languages
do not say that they hold these, and then a rerun does not count as one that held them.
"""

import os
from collections.abc import Iterable
from pathlib import Path

from ...schemas.runs.programs import BoxPlan, ProgramPlan
from ...schemas.runs.verification import Factor
from ..runtime.process import held_sources
from ..runtime.process.held_sources import HELD_VARIABLE, MARK_VARIABLE
from ..runtime.process.run_request import RunRequest
from .causes import UNUSED, UNWATCHED, Held, Hold, Weights

_INSIDE: tuple[Factor, ...] = ("seed", "time", "threads", "hash")
"""Factors that programs hold themselves."""
_IMPORT_PATH = "PYTHONPATH"
_OF_SIMULATION = "the simulation"
"""Name of the file in which the simulation's process writes."""


class Marks:
    """Folder in which processes of a rerun write what they hold and use, with the code that lets them.

    Args:
        folder: New folder, in which the processes may write.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._said = folder / "said"
        self._said.mkdir(parents=True)
        # Its name makes Python import it at the start of each program.
        code = Path(held_sources.__file__).read_text()
        (folder / "sitecustomize.py").write_text(code)

    def path(self, program: str) -> Path:
        """Returns the path of the file in which a program of a rerun writes what it holds and uses."""
        return self._said / program

    def held(self, asked: Held, programs: Iterable[str]) -> Held:
        """Returns the factors that were held in fact: those that all programs say they hold, and those outside them."""
        inside = [self._words(program, "held") for program in programs]
        return frozenset(each for each in asked if each not in _INSIDE or all(each in words for words in inside))

    def used(self) -> set[str]:
        """Returns the factors that processes were seen to use."""
        return {word for file in self._said.iterdir() for word in self._words(file.name, "used")}

    def are_watched(self, programs: Iterable[str]) -> bool:
        """Returns whether all of these programs said what they use."""
        return all(self.path(program).exists() for program in programs)

    def _words(self, program: str, kind: str) -> set[str]:
        path = self.path(program)
        if not path.exists():
            return set()
        lines = (line.partition(" ") for line in path.read_text(errors="replace").splitlines())
        said = [set(words.split(",")) for first, _, words in lines if first == kind]
        # Of several processes of a program the last to begin may hold less.
        return set.intersection(*said) if kind == "held" and said else set().union(*said)


def programs_of(request: RunRequest) -> list[str]:
    """Returns the names of the processes that have to hold what is held inside programs."""
    programs = [each.name for each in request.plan.programs if each.kind == "application"]
    return [_OF_SIMULATION, *programs] if request.plan.has_episode else programs


def held_request(request: RunRequest, hold: Hold, marks: Marks) -> RunRequest:
    """Makes the request of a rerun that holds factors.

    Args:
        request: Request of a rerun that holds none.
        hold: Factors to hold, with their values.
        marks: Folder of the rerun.
    """
    held, values = hold.held, dict(hold.values)
    inside = ",".join(f"{each}:{values[each]}" if each in values else each for each in _INSIDE if each in held)
    programs = [_held_program(each, request, inside, marks) for each in request.plan.programs]
    environment = {HELD_VARIABLE: inside, MARK_VARIABLE: str(marks.path(_OF_SIMULATION))}
    plan = request.plan.model_copy(update={"programs": programs})
    cores = [min(request.cores or os.sched_getaffinity(0))] if "threads" in held else request.cores
    changes = {"plan": plan, "environment": {**request.environment, **environment}, "cores": cores}
    return request.model_copy(update={**changes, "box": _held_box(request.box, held)})


def _held_program(program: ProgramPlan, request: RunRequest, inside: str, marks: Marks) -> ProgramPlan:
    if program.cleanup_argv is not None:
        return program  # a container has files of its own
    of_role = request.plan.robot_application if program.role == "robot" else request.plan.simulation_application
    given = {
        **request.environment,
        **(of_role.environment_variables if of_role else {}),
        **program.environment,
    }
    path = os.pathsep.join([str(marks.folder), *filter(None, [given.get(_IMPORT_PATH)])])
    own = {_IMPORT_PATH: path, HELD_VARIABLE: inside, MARK_VARIABLE: str(marks.path(program.name))}
    return program.model_copy(update={"environment": {**program.environment, **own}})


def _held_box(box: BoxPlan, held: Held) -> BoxPlan:
    changes = {}
    if "files" in held or "network" in held:
        changes["level"] = "box"
    if "network" in held:
        changes |= {"network": "none", "services": []}
    return box.model_copy(update=changes)


def weights_of(used: set[str], *, is_watched: bool, box: BoxPlan, can_box: bool, has_neighbours: bool) -> Weights:
    """Returns the factors that can be held, with their weights before any rerun.

    Args:
        used: Factors that the processes were seen to use.
        is_watched: Whether all processes were watched.
        box: Box of the job's processes.
        can_box: Whether this machine has boxes.
        has_neighbours: Whether another job ran at the same time as the run.
    """
    factors: list[Factor] = ["seed", "time", "threads", "hash"]
    if can_box and box.network != "none":
        factors.append("network")
    if can_box and box.level != "box":
        factors.append("files")  # in a box, nothing is left behind
    if has_neighbours:
        factors.append("order")
    if "order" in used and not has_neighbours:
        used = used | {"network"}  # other programs of the machine can have the address
    unused: dict[Factor, float] = {"hash": UNWATCHED}
    return {
        each: 1.0 if each in used or not is_watched or each == "order" else unused.get(each, UNUSED) for each in factors
    }
