"""Files that robots download: copies on this machine of the installation files of open orders."""

import threading
from pathlib import Path

from ...schemas.fleet.rollouts.rollout_plan import Artifact
from ...schemas.wire.errors import ObjectNotFoundError
from ..service.service import Service
from .ddi.orders import RobotOrder
from .order_keeping import OrderKeeper


class BundleFiles:
    """Local copies of installation files that robots download; usable from any thread.

    Args:
        service: The service, with its catalog and object store.
        keeper: Knows which file an order has.
    """

    def __init__(self, service: Service, keeper: OrderKeeper) -> None:
        self._service = service
        self._keeper = keeper
        self._lock = threading.Lock()
        self._fetching: dict[str, threading.Lock] = {}

    def path_of(self, order: RobotOrder) -> Path:
        """Returns the local path of an order's installation file, after downloading it if necessary.

        Raises:
            ObjectNotFoundError: No rollout has it any more, or it is gone.
            StorageError: The file cannot be downloaded.
        """
        artifact = self._keeper.artifact(order)
        if artifact is None:
            raise ObjectNotFoundError(f"no deployment has the file of order {order.action_id} any more")
        here = self._service.store.local_path(artifact.bucket, artifact.key)
        return here if here is not None else self._fetched(artifact)

    def remove_others(self) -> None:
        """Deletes local copies of installation files (`.swu`) that no open deployment to robots needs."""
        wanted = {f"{sha256}.swu" for sha256 in self._keeper.files()}
        for path in self._folder().glob("*.swu"):
            if path.name not in wanted:
                path.unlink(missing_ok=True)

    def _fetched(self, artifact: Artifact) -> Path:
        path = self._folder() / f"{artifact.sha256}.swu"
        if not path.exists():
            with self._lock:
                lock = self._fetching.setdefault(artifact.sha256, threading.Lock())
            with lock:
                if not path.exists():
                    self._service.store.get_file(artifact.bucket, artifact.key, path)
        return path

    def _folder(self) -> Path:
        return self._service.folder("cache", "robots")
