"""Writes video files: H.264 in MP4, while the simulation steps."""

from fractions import Fraction
from pathlib import Path

import av

from ..rendering.cameras import Image
from .video_files import unfinished


class VideoWriter:
    """An H.264 file that has its name only when it is complete."""

    def __init__(self, path: Path, size: tuple[int, int], rate_hz: int) -> None:
        """Opens the file.

        Args:
            path: Where it will be.
            size: Width and height in pixels, both even.
            rate_hz: Pictures per second.

        Raises:
            OSError: It cannot be written.
        """
        self.frames = 0
        self.rate_hz = rate_hz
        self._path = path
        self._unfinished = unfinished(path)
        self._container = av.open(str(self._unfinished), "w", format="mp4", options={"movflags": "faststart"})
        self._stream = self._container.add_stream("libx264", rate=rate_hz)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        # One thread: as many runs as cores are usually going on at a time.
        self._stream.options = {"preset": "veryfast", "threads": "1"}
        self._stream.codec_context.time_base = Fraction(1, rate_hz)

    def add(self, picture: Image) -> None:
        """Adds the next picture."""
        frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
        frame.pts = self.frames
        frame.time_base = Fraction(1, self.rate_hz)
        self._container.mux(self._stream.encode(frame))
        self.frames += 1

    def close(self) -> None:
        """Finishes the file and gives it its name."""
        self._container.mux(self._stream.encode(None))
        self._container.close()
        self._unfinished.replace(self._path)

    def abandon(self) -> None:
        """Closes and deletes the unfinished file."""
        self._container.close()
        self._unfinished.unlink(missing_ok=True)
