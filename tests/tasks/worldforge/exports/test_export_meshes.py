"""What meshes are written as: flat ones share their vertices, and keep their edges."""

import io

import mujoco
import numpy as np
import pytest
import trimesh

from prefect_robomaker.tasks.worldforge.exports.export_meshes import (
    Mesh,
    compiled_mesh,
    obj_text,
    picture_places,
    unit_mesh,
)

SHAPE = """<mujoco><asset>
<mesh name="roof" vertex="0 0 0  1 0 0  1 1 0  0 1 0  .5 .5 1" face="0 2 1  0 3 2  0 1 4  1 2 4  2 3 4  3 0 4"
 texcoord="0 0  1 0  1 1  0 1  .5 .5"/></asset>
<worldbody><geom type="mesh" mesh="roof"/></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SHAPE)


def normals_of_faces(mesh: Mesh) -> np.ndarray:
    one, two, three = (mesh.positions[mesh.triangles[:, corner]] for corner in range(3))
    across = np.cross(two - one, three - one)
    return across / np.linalg.norm(across, axis=1, keepdims=True)


def test_a_compiled_mesh_shares_vertices_and_has_the_normals_of_its_faces(model: mujoco.MjModel) -> None:
    mesh = compiled_mesh(model, 0)

    assert mesh.flat
    assert len(mesh.positions) == 5
    assert mesh.normals == pytest.approx(normals_of_faces(mesh))
    assert mesh.apart().normals == pytest.approx(np.repeat(normals_of_faces(mesh), 3, axis=0))
    assert mesh.apart().positions[mesh.apart().triangles] == pytest.approx(mesh.positions[mesh.triangles])


def test_a_face_without_an_area_has_no_normal() -> None:
    line = SHAPE.replace("3 0 4", "3 0 4  0 1 1")
    mesh = compiled_mesh(mujoco.MjModel.from_xml_string(line), 0)

    assert np.isfinite(mesh.normals).all()


@pytest.mark.parametrize("pictured", [False, True])
def test_an_obj_file_is_the_mesh(model: mujoco.MjModel, pictured: bool) -> None:
    mesh = compiled_mesh(model, 0)
    places = picture_places(model, 0) if pictured else None
    text = obj_text(mesh, places)
    rows = [line.split() for line in text.splitlines()]
    vertices, normals, spots = (
        np.array([row[1:] for row in rows if row[0] == kind], dtype=float) for kind in ("v", "vn", "vt")
    )
    faces = [[corner.split("/") for corner in row[1:]] for row in rows if row[0] == "f"]

    for at, face in enumerate(faces):
        for side, (vertex, spot, normal) in enumerate(face):
            assert vertices[int(vertex) - 1] == pytest.approx(mesh.positions[mesh.triangles[at, side]], abs=1e-4)
            assert normals[int(normal) - 1] == pytest.approx(mesh.normals[at], abs=1e-3)
            if places is not None:
                assert spots[int(spot) - 1] == pytest.approx(places[3 * at + side], abs=1e-4)
            else:
                assert spot == ""
    read = trimesh.load_mesh(io.BytesIO(text.encode()), file_type="obj", process=False)
    assert read.volume == pytest.approx(1 / 3, abs=1e-3)


def test_round_meshes_keep_a_normal_at_each_vertex() -> None:
    ball = unit_mesh("sphere")

    assert not ball.flat
    assert ball.apart() is ball
    assert obj_text(ball).count("\nvn ") == len(ball.positions)
