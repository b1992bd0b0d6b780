"""A cloth mesh is right from the start: topology checked against brute force, every kind of bad mesh refused."""

from __future__ import annotations

import numpy as np
import pytest

from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
TWO = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("pattern", ["uniform", "alternating"])
def test_the_cloth_of_the_paper_has_its_counts(pattern):
    """docs/sources.md, The piece of cloth: V 484, F 882, E 1365, boundary 84, interior 1281."""
    mesh = square_grid(4.8, 22, pattern)
    counts = (mesh.num_vertices, mesh.num_faces, mesh.num_edges, mesh.boundary.sum(), (~mesh.boundary).sum())
    assert counts == (484, 882, 1365, 84, 1281)
    assert np.ptp(mesh.rest_positions, axis=0) == pytest.approx([4.8, 4.8, 0.0])


def test_the_grid_lies_as_documented():
    mesh = square_grid(2.0, 3)
    assert mesh.rest_positions[0].tolist() == [-1, 1, 0]
    assert mesh.rest_positions[2].tolist() == [1, 1, 0]
    assert mesh.rest_positions[6].tolist() == [-1, -1, 0]
    a, b, c = (mesh.rest_positions[mesh.faces[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_patterns_differ_in_their_diagonals():
    uniform, alternating = (square_grid(1.0, 4, pattern) for pattern in ("uniform", "alternating"))
    flipped = {tuple(edge) for edge in alternating.edges} - {tuple(edge) for edge in uniform.edges}
    assert len(flipped) == 4


@pytest.mark.parametrize("arguments", [(0.0, 3), (-1.0, 3), (1.0, 1), (1.0, 3, "spiral")])
def test_grids_that_make_no_sense_are_refused(arguments):
    with pytest.raises(DrapeError, match="expected size > 0, resolution >= 2 and a pattern among uniform, alternating"):
        square_grid(*arguments)


def test_edges_agree_with_brute_force():
    mesh = square_grid(1.0, 5, "alternating")
    faces_of = {}
    for face, corners in enumerate(mesh.faces.tolist()):
        for k in range(3):
            edge = tuple(sorted((corners[k], corners[k - 1])))
            faces_of.setdefault(edge, []).append((face, next(c for c in corners if c not in edge)))
    assert [tuple(edge) for edge in mesh.edges.tolist()] == sorted(faces_of)
    for edge, faces, opposite, boundary in zip(
        mesh.edges.tolist(), mesh.edge_faces.tolist(), mesh.edge_opposite.tolist(), mesh.boundary, strict=True
    ):
        expected = faces_of[tuple(edge)]
        assert boundary == (len(expected) == 1)
        assert set(zip(faces, opposite, strict=True)) == set(expected)


def test_rest_lengths():
    mesh = ClothMesh.from_faces(SQUARE, TWO)
    assert dict(zip(map(tuple, mesh.edges.tolist()), mesh.rest_lengths, strict=True)) == pytest.approx(
        {(0, 1): 1.0, (0, 2): 2**0.5, (0, 3): 1.0, (1, 2): 1.0, (2, 3): 1.0}
    )


def test_a_mesh_cannot_be_changed():
    mesh = square_grid(1.0, 3)
    with pytest.raises(ValueError, match="read-only"):
        mesh.rest_positions[0] = 0.0
    with pytest.raises(AttributeError):
        mesh.faces = mesh.faces


def moved(index: int, to: list[float]) -> np.ndarray:
    positions = SQUARE.copy()
    positions[index] = to
    return positions


FAN = np.array([[0, 1, 2], [0, 2, 3], [0, 2, 4]])
FIN = np.vstack([SQUARE, [[0.5, 0.5, 1.0]]])

BAD = {
    "duplicate vertices": (moved(3, [0, 0, 0]), TWO, "1 duplicate vertices .*; merge them"),
    "nan": (moved(2, [np.nan, 0, 0]), TWO, r"vertex 2 is at \[nan .*; expected finite rest positions"),
    "infinite": (moved(1, [np.inf, 0, 0]), TWO, r"vertex 1 is at \[inf .*; expected finite rest positions"),
    "repeated corner": (SQUARE, np.array([[0, 1, 1], [0, 2, 3]]), "1 faces have no area .*first: 0, vertices"),
    "no area": (moved(1, [0.5, 0.5, 0]), TWO, r"1 faces have no area .*\[0, 1, 2\]"),
    "opposite winding": (SQUARE, np.array([[0, 1, 2], [0, 3, 2]]), "neighbouring faces wind in opposite directions"),
    "face twice": (SQUARE, np.array([[0, 1, 2], [0, 2, 3], [1, 2, 0]]), "1 faces stand twice; remove the copies"),
    "face twice, reversed": (SQUARE, np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0]]), "1 faces stand twice"),
    "unused vertex": (FIN, TWO, r"1 vertices belong to no face \(first: 4\); remove them"),
    "index too large": (SQUARE, np.array([[0, 1, 2], [0, 2, 4]]), r"faces index 0\.\.4, expected 0\.\.3"),
    "negative index": (SQUARE, np.array([[0, 1, 2], [0, 2, -1]]), r"faces index -1\.\.2, expected 0\.\.3"),
    "no faces": (SQUARE, np.zeros((0, 3), np.int64), "found no faces; expected a triangle mesh"),
}


def test_three_faces_at_an_edge_are_a_piece_of_cloth_and_the_border_of_another():
    """The two that go on straightest belong together, whichever comes first."""
    for order in ([0, 1, 2], [2, 1, 0], [1, 2, 0]):
        mesh = ClothMesh.from_faces(FIN, FAN[order])
        rows = (mesh.edges == [0, 2]).all(axis=1)
        assert rows.sum() == 2
        faces = map(tuple, np.sort(mesh.edge_faces[rows], axis=1).tolist())
        pairs = dict(zip(faces, mesh.boundary[rows], strict=True))
        flat, fin = (tuple(sorted(order.index(face) for face in faces)) for faces in ([0, 1], [2, 2]))
        assert pairs == {flat: False, fin: True}


def test_four_faces_at_an_edge_are_two_pieces_of_cloth():
    """Two planes that cross: each goes on through the other."""
    cross = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], float)
    mesh = ClothMesh.from_faces(cross, np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 0, 5]]))
    rows = (mesh.edges == [0, 1]).all(axis=1)
    assert sorted(map(sorted, mesh.edge_faces[rows].tolist())) == [[0, 1], [2, 3]]
    assert not mesh.boundary[rows].any()


@pytest.mark.parametrize("name", BAD)
def test_bad_meshes_are_refused_with_a_sentence(name):
    positions, faces, sentence = BAD[name]
    with pytest.raises(DrapeError, match=f"^shirt.obj: {sentence}"):
        ClothMesh.from_faces(positions, faces, name="shirt.obj")


def test_meshes_with_holes_and_several_pieces_are_fine():
    two_pieces = ClothMesh.from_faces(np.vstack([SQUARE, SQUARE + 3]), np.vstack([TWO, TWO + 4]))
    assert two_pieces.num_edges == 10


def test_a_batch_is_its_meshes_side_by_side(small_cloth, cloth):
    batch = MeshBatch.from_meshes([small_cloth, cloth, small_cloth])
    assert batch.num_meshes == 3
    assert batch.num_vertices == 2 * small_cloth.num_vertices + cloth.num_vertices
    first = small_cloth.num_vertices
    of_second = batch.mesh_of_edge == 1
    assert (batch.edges[of_second].numpy() - first == cloth.edges).all()
    assert (batch.edge_faces[of_second].numpy() - small_cloth.num_faces == cloth.edge_faces).all()
    assert (batch.mesh_of_vertex[batch.edges] == batch.mesh_of_edge[:, None]).all()
    assert (batch.mesh_of_vertex[batch.faces].diff(dim=1) == 0).all()
    lengths = batch.sum_edges(batch.rest_lengths)
    assert lengths.tolist() == pytest.approx([m.rest_lengths.sum() for m in (small_cloth, cloth, small_cloth)])
