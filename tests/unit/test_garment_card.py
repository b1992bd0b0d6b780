"""What is said and drawn of a data set of garments."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import trimesh

from drape.data import schema
from drape.data.hdf5 import GarmentFile
from drape.data.stored_part import Header, StoredBody, StoredGarment, StoredSequence
from drape.report.contact_sheet import draw_contact_sheet
from drape.report.dataset_card import dataset_card
from tests.garments import write_groups

QUALITY = {
    "inside_mean": 0.0001, "inside_worst": 0.002, "self_intersection_mean": 0.001, "self_intersection_worst": 0.01,
    "stretch_mean": 1.01, "stretch_99": 1.1, "speed": 2.0, "repaired": False,
}  # fmt: skip


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> GarmentFile:
    """Two training sequences and one of the test split: balls in balls."""
    path = tmp_path_factory.mktemp("card") / "garments.h5"
    ball = trimesh.creation.icosphere(2, 0.2)
    x, faces = np.asarray(ball.vertices), np.asarray(ball.faces, np.int64)
    settings = dict.fromkeys(schema.MATERIAL_ATTRIBUTES, 1.0) | {"preset": "Silk"}
    materials = {"silk": settings, "denim": settings}
    header = Header("blender 5.0.1", 30.0, (0.0, 0.0, -9.81), materials, "{}", seed=7)
    garments = {
        name: StoredGarment(kind, body, 1.2 * x, faces)
        for name, kind, body in (("00000", "dress", "000"), ("00001", "skirt", "000"), ("00002", "dress", "001"))
    }
    frames = np.repeat(1.2 * x[None], 4, axis=0) + np.linspace(0, 0.1, 4)[:, None, None]
    bodies = frames / 1.2
    rows = [
        ("00000", "000", "walk", "train", "silk", 1, QUALITY),
        ("00001", "000", "jump", "train", "denim", 2, QUALITY | {"inside_worst": 0.001, "speed": 5.0}),
        ("00002", "001", "dance", "test", "silk", 1, QUALITY | {"repaired": True, "twin_distance": 0.0123}),
    ]
    sequences = [
        StoredSequence(
            name, body, motion, split, name, fabric, 0.15, 2.0, attempts, quality, frames, body_positions=bodies
        )
        for name, body, motion, split, fabric, attempts, quality in rows
    ]
    write_groups(path, header, {"000": StoredBody(x, faces), "001": StoredBody(x, faces)}, garments, sequences)
    return GarmentFile(path)


def test_the_card_counts_what_quality_control_did(file: GarmentFile) -> None:
    card = dataset_card(file)
    for text in (
        "3 sequences of 4 frames",
        "gravity 9.810 m/s2, seed 7, blender 5.0.1",
        "train: 2 sequences, 1 bodies, 2 garments, motions walk, jump; 1 silk, 1 denim",
        "test: 1 sequences, 1 bodies, 1 garments, motions dance; 1 silk, 0 denim",
        "1 drawn anew, 1 repaired with more solver steps: 66.7 % of the sequences",
    ):
        assert text in card
    rows = {line.split()[0]: line.split() for line in card.splitlines()}
    assert rows["dress"][1:6] == ["1", "1", "162-162", "0", "1"]
    assert rows["skirt"][1:6] == ["1", "0", "162-162", "1", "0"]
    assert rows["all"][6:9] == ["0.010", "|", "0.20"]
    assert rows["dress"][-1] == "12.3"
    assert rows["skirt"][-2:] == ["5.0", "-"]


def test_the_sheet_shows_one_row_for_each_kind(file: GarmentFile, tmp_path: Path) -> None:
    path = draw_contact_sheet(file, tmp_path / "sheet.png")
    picture = matplotlib.image.imread(path)[..., :3]
    assert 400 < picture.shape[0] < 450  # two rows
    for part in np.array_split(picture, 2):
        assert part.std() > 0.05
