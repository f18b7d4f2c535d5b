"""Textures as PNG files that come with the package, since painting and packing one takes longer than furnishing a room.

    python -m prefect_robomaker.tasks.worldforge.materials.texture_files

paints them anew, after a change of a finish or a pattern.
"""

from functools import lru_cache
from pathlib import Path

from .materials import FLOORS, WALLS
from .textures import SKY, painted_png, texture_size_m

FOLDER = Path(__file__).with_name("assets")
"""Folder of the texture files, `<surface>.png` each."""


def textured() -> list[str]:
    """Lists the names of all textures: the sky, and surfaces whose finish is not plain."""
    surfaces = [
        f"{surface}_{material}_{finish.name}"
        for surface, table in (("floor", FLOORS), ("wall", WALLS))
        for material, made in table.items()
        for finish in made.finishes
    ]
    return [SKY, *(name for name in surfaces if texture_size_m(name) is not None)]


@lru_cache(maxsize=64)
def texture_png(name: str) -> bytes:
    """Returns a texture as PNG, the same bytes on every machine.

    Args:
        name: One of `textured()`.
    """
    return (FOLDER / f"{name}.png").read_bytes()


def write_textures(folder: Path) -> None:
    """Paints all textures and writes them as PNG to a folder, which is made if needed; deletes other pictures in it."""
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()
    for name in textured():
        (folder / f"{name}.png").write_bytes(painted_png(name))


if __name__ == "__main__":
    write_textures(FOLDER)
