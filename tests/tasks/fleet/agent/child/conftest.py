"""A robot in this process, at a repository in a folder: what it would install, and what it refuses."""

from dataclasses import dataclass, field
from pathlib import Path

import pytest
from helpers.tuf_repository import TufRepository

from prefect_robomaker.tasks.fleet.agent.child.fetching import HttpStatus, Part, fetch
from prefect_robomaker.tasks.fleet.agent.child.trust import Repository
from prefect_robomaker.tasks.fleet.agent.deployment import Deployment, Order
from prefect_robomaker.tasks.fleet.agent.errors import StepFailed
from prefect_robomaker.tasks.fleet.agent.state_machine import State, Trusted, advance

FRESH_S = 1_700_000_000.0


@dataclass
class Robot:
    """A robot in this process, at a repository in a folder."""

    folder: Path
    repository: TufRepository
    root: bytes
    state: State = field(default_factory=State)
    now_s: float = FRESH_S

    def read(self, path: str, start: int) -> Part:
        """Reads a file of the repository."""
        file = self.repository.folder / path
        if not file.is_file():
            raise HttpStatus(404)
        return Part(start, iter([file.read_bytes()[start:]]))

    def _saw(self, trusted: Trusted) -> None:
        self.state = advance(self.state, trusted)

    def resolve(self, target: str) -> Deployment:
        """Asks what an order is."""
        repository = Repository(self.read, self.root, self.folder / "metadata", self.folder / "downloads", self.now_s)
        return repository.resolve(Order(1, target), self.state.floors, self.state.newest_s, "X86_64", self._saw)

    def install(self, target: str) -> bytes:
        """The bundle that would be installed."""
        deployment = self.resolve(target)
        path = self.folder / "downloads" / deployment.bundle.sha256
        fetch(self.read, deployment.bundle, path)
        return path.read_bytes()


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    repository = TufRepository(tmp_path / "repository")
    return Robot(tmp_path / "robot", repository, repository.first_root)


def refused(robot: Robot, target: str) -> StepFailed:
    with pytest.raises(StepFailed) as caught:
        robot.install(target)
    return caught.value
