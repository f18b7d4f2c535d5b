"""The physics of a run as bytes, for checkpoints."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import zlib
from pathlib import Path

import mujoco
import numpy as np

from .checkpoint_files import CheckpointError, write_whole
from .digest import digest_of_model

_MOST_MODELS = 3
"""Models that are kept apart; of environments that change theirs more often, each checkpoint has its own."""


class KeptPhysics:
    """MuJoCo's data as bytes, without the model that comes with them: it is most of them, and hardly ever changes."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._common = b""
        self._name = ""
        self._models = 0

    def kept(self, data: mujoco.MjData) -> tuple[str, bytes]:
        """Returns the file with the common beginning, and what is different."""
        whole = data.__getstate__()
        if not (self._common and whole.startswith(self._common)) and self._models < _MOST_MODELS:
            self._keep_model(data.model, whole)
        if not whole.startswith(self._common):
            return "", whole
        return self._name, whole[len(self._common) :]

    def read(self, name: str, rest: bytes) -> mujoco.MjData:
        """Returns the data that `kept` was given.

        Raises:
            CheckpointError: The file with the model is gone, or not whole.
        """
        common = b""
        if name:
            try:
                common = (self._folder / name).read_bytes()
            except OSError as error:
                raise CheckpointError(f"its model cannot be read: {error}") from error
            if name != _model_file(common):
                raise CheckpointError(f"{self._folder / name} is not whole")
        data = mujoco.MjData.__new__(mujoco.MjData)
        data.__setstate__(common + rest)
        return data

    def _keep_model(self, model: mujoco.MjModel, whole: bytes) -> None:
        self._models += 1
        content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, content)
        place = whole.find(content.tobytes())
        self._common = whole[: place + len(content)] if place >= 0 else b""
        self._name = _model_file(self._common) if self._common else ""
        if self._name:
            write_whole(self._folder / self._name, self._common)


def _model_file(content: bytes) -> str:
    # Guards against truncated files, not against attacks; and the first checkpoint should be quick.
    return f"model-{len(content)}-{zlib.crc32(content):08x}.bin"


def copy_physics(kept: mujoco.MjData, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Puts kept physics in the place of what an environment has just made.

    Raises:
        CheckpointError: The environment made another model.
    """
    if digest_of_model(kept.model) != digest_of_model(model):
        raise CheckpointError("the environment built another model than it had then")
    mujoco.mj_copyData(data, model, kept)
