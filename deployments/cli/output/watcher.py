"""The interface for showing the progress of a running pipeline."""

from contextlib import AbstractContextManager

from ....schemas.reports.progress import ProgressEvent


class Watcher(AbstractContextManager["Watcher"]):
    """A listener that shows what it hears while it is entered."""

    def __call__(self, event: ProgressEvent) -> None:
        """Takes one event; from any thread."""
        raise NotImplementedError
