"""The page of results: every row, links that exist, well-formed HTML, sentences where a film is missing."""

from __future__ import annotations

import dataclasses
import shutil
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from PIL import Image

from drape.data.animation_hdf5 import AnimationHeader
from drape.data.animation_writer import AnimationWriter
from drape.data.hdf5 import GarmentFile
from drape.data.recorded_scene import recorded_scene
from drape.metrics.record import EvaluationRecord
from drape.report import clips
from drape.report.clips import one_of_each_kind
from drape.report.garment_rows import GarmentRow, garment_rows
from drape.report.page import Page
from drape.report.page_parts import Cell, ScoreTable
from drape.report.raster import Surface, cut_out, draw
from drape.report.stage import MOST_ERROR, RIGHT, WRONG, Stage, shown_frames, smoothed
from drape.report.table import Table
from drape.scene.camera import Camera
from drape.scene.state import State
from tests import garments
from tests.unit.test_report_garments import record, trained

NAMES = ("00001", "00002")
VOID = {"meta", "img", "source", "br", "link"}


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return garments.write(tmp_path_factory.mktemp("data") / "garments.h5")


def evaluated(data: Path, folder: Path, name: str, offset: float = 0.01, **about: object) -> EvaluationRecord:
    """An evaluation whose garments are the recorded ones, ``offset`` metres beside."""
    with GarmentFile(data) as file:
        for sequence in map(file.sequence, NAMES):
            scene = recorded_scene(sequence)
            header = AnimationHeader.of_scene(scene, {}, "{}")
            with AnimationWriter(folder / "sequences" / f"{sequence.name}.h5", header) as writer:
                for x in scene.reference:
                    writer.append(State(x + [offset, 0.0, 0.0], np.zeros_like(x)), {})
    lines = [f"{each},dress,12.5,0.25" for each in NAMES]
    (folder / "sequences.csv").write_text("\n".join(["sequence,kind,error_mm,collision_percent", *lines]) + "\n")
    lines = [f"{each},dress,{k},{10 * k},0.5" for each in NAMES for k in (1, 2)]
    (folder / "by_frame.csv").write_text("\n".join(["sequence,kind,frame,error_mm,floor_mm", *lines]) + "\n")
    training = about.pop("training", None)
    made = record(name, 10.0, training, path=str(data), sequences=list(NAMES), frames=[4, 4], **about)
    return dataclasses.replace(made, folder=folder)


class Checked(HTMLParser):
    """Complains about tags that are not closed in their order; gathers links, words and marks."""

    def __init__(self, text: str):
        super().__init__()
        self.open, self.links, self.marks, self.words = [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        for key, value in attributes:
            if key in ("src", "href", "srcset"):
                self.links.append(value)
            if key == "id":
                self.marks.append(value)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, words):
        self.words.append(words)


@pytest.fixture(scope="module")
def page(data, tmp_path_factory) -> tuple[Path, list[EvaluationRecord]]:
    runs = tmp_path_factory.mktemp("runs")
    named = {"command": "python src/evaluate.py 'name=solver <b>&amp;'"}
    found = [
        evaluated(data, runs / "a", "hood_seed0", training=trained("hood")),
        evaluated(data, runs / "b", "solver <b>&amp;", 0.2, method={"energy": {}}, provenance=named),
        evaluated(data, runs / "c", "broken", 0.0),
        evaluated(data, runs / "d", "twin", 0.0, target="drape.simulators.baselines.Twin"),
    ]
    (runs / "c" / "sequences" / "00002.h5").unlink()
    (runs / "eunet" / "figures").mkdir(parents=True)
    Image.new("RGB", (4, 4)).save(runs / "eunet" / "figures" / "energy_map.png")
    cells = "EUNet", "1.00 ± 0.20 (0.90…1.10)"
    law = Table("Energy <of> fabrics", ("row", "silk"), (cells,), footnotes=("a: <x>",))
    return Page(runs / "page", sequences=2, height=60).write(found, [], runs, [law]), found


def test_the_page_is_well_formed_and_shows_every_row(page):
    path, found = page
    text = path.read_text(encoding="utf-8")
    checked = Checked(text)
    words = " ".join(checked.words)
    for label in ("HOOD", "HOOD w/o EST (paper)", "solver <b>&amp;", "broken", "noise floor (twin)", "recorded"):
        assert label in words
    assert "solver <b>" not in text
    assert "Energy <of> fabrics" in words
    assert "a: <x>" in words
    assert '1.00 <small>± 0.20</small> <small class="seeds">(0.90…1.10)</small></td>' in text
    assert '<tr class="paper"><th scope="row">HOOD (paper)' in text
    assert 'class="best"' in text
    assert "12.5 mm" in words
    assert "0.25 % collision" in words
    for each in found:
        assert each.provenance["command"] in words


def test_links_are_relative_and_lead_somewhere(page):
    path, _ = page
    checked = Checked(path.read_text(encoding="utf-8"))
    assert len([link for link in checked.links if link.endswith(".webp")]) > 10
    assert len([link for link in checked.links if link.endswith(".svg")]) == 4
    assert "page.css" in checked.links
    assert any(link.endswith(".png") for link in checked.links), "the map that a training has left"
    for link in checked.links:
        if link.startswith("#"):
            assert link[1:] in checked.marks
        else:
            assert ":" not in link
            assert not link.startswith(("/", ".."))
            assert (path.parent / unquote(link)).is_file(), link


def test_a_missing_animation_is_a_sentence_and_the_others_are_there(page):
    words = Checked(page[0].read_text(encoding="utf-8")).words
    sentences = [word for word in words if word.startswith("Nothing to show")]
    assert len(sentences) == 1
    assert "00002.h5" in sentences[0]


def test_missing_data_are_a_sentence(tmp_path):
    made = dataclasses.replace(record("a", 10.0, path=str(tmp_path / "gone.h5")), folder=tmp_path)
    text = Page(tmp_path / "page", sequences=1).write([made], [], tmp_path, []).read_text()
    assert "Nothing to show" in text
    assert "gone.h5" in text


def test_other_vertices_than_the_data_have_are_a_sentence(data, tmp_path):
    made = evaluated(data, tmp_path / "a", "a")
    with GarmentFile(data) as file:
        scene = recorded_scene(file.sequence("00001"))
    header = dataclasses.replace(
        AnimationHeader.of_scene(scene, {}, "{}"), faces=np.array([[0, 1, 2]]),
        rest_positions=np.zeros((3, 3)), mass=np.ones(3), obstacle=None,
    )  # fmt: skip
    (made.folder / "sequences" / "00001.h5").unlink()
    with AnimationWriter(made.folder / "sequences" / "00001.h5", header) as writer:
        writer.append(State(np.zeros((3, 3)), np.zeros((3, 3))), {})
    lane = clips.show(garment_rows([made]), 1, tmp_path / "clips", 40)[0].lanes[1]
    assert "found 1 frames of 3 vertices" in lane.problem
    assert lane.clip is None


def test_clips_are_kept_until_their_animation_changes(data, tmp_path):
    made = evaluated(data, tmp_path / "a", "a")
    rows = garment_rows([made])

    def lanes() -> dict[str, tuple[Path, int]]:
        (shown,) = clips.show(rows, 1, tmp_path / "clips", 40)
        return {lane.label: (lane.clip, lane.clip.stat().st_mtime_ns) for lane in shown.lanes}

    first = lanes()
    assert lanes() == first
    shutil.rmtree(made.folder)
    evaluated(data, tmp_path / "a", "a", 0.05)
    second = lanes()
    assert second["recorded"] == first["recorded"]
    assert second["a"] != first["a"]
    assert not first["a"][0].exists(), "the older one goes"
    assert len(list((tmp_path / "clips" / "00001").iterdir())) == 4


def test_a_clip_moves_in_real_time_is_small_and_has_no_background(data, tmp_path):
    made = evaluated(data, tmp_path / "a", "a")
    (shown,) = clips.show(garment_rows([made]), 1, tmp_path / "clips", 60)
    for lane in shown.lanes:
        assert lane.clip.stat().st_size < clips.MOST_BYTES
        with Image.open(lane.clip) as film:
            assert (film.size, film.n_frames, film.info["loop"]) == ((45, 60), 3, 0)
            durations = []
            for k in range(film.n_frames):
                film.seek(k)
                film.load()
                durations.append(film.info["duration"])
            assert durations == [67, 67, clips.LAST_SHOWN], "every second of 30 frames a second"
            opacity = np.asarray(film.convert("RGBA"))[..., 3]
        assert opacity[0, 0] == 0
        assert opacity.max() == 255


def test_sequences_in_motion_are_of_different_kinds(tmp_path):
    kinds = {"0": "dress", "1": "dress", "2": "skirt", "3": "dress", "4": "top"}
    lines = [f"{name},{kind}" for name, kind in kinds.items()]
    (tmp_path / "sequences.csv").write_text("\n".join(["sequence,kind", *lines]) + "\n")
    row = GarmentRow("a", (dataclasses.replace(record("a", 1.0, sequences=list(kinds)), folder=tmp_path),))
    assert one_of_each_kind(row, 4) == ["0", "2", "4", "1"]
    (tmp_path / "sequences.csv").unlink()
    assert one_of_each_kind(row, 2) == ["0", "1"]


# Pieces


def test_the_lowest_of_ours_is_marked():
    rows = (("a", "2.00", "1"), ("b", "1.50 ± 3.00 (1.40…1.60)", "3"), ("c (paper)", "0.10", ""), ("d", "", "1"))
    table = Table("T", ("method", "overall", "seeds"), rows)
    found = ScoreTable.of(table, best=True)
    assert [(row.label, cell.number) for row in found.rows for cell in row.cells if cell.is_best] == [("b", "1.50")]
    assert found.rows[1].cells[0] == Cell("1.50", "3.00", "1.40…1.60", True)
    assert [row.kind for row in found.rows] == ["", "", "paper", ""]
    assert not any(cell.is_best for row in ScoreTable.of(table).rows for cell in row.cells)


def square(x: float = 0.0) -> np.ndarray:
    return np.array([[x - 1.0, 0.0, -1.0], [x + 1.0, 0.0, -1.0], [x + 1.0, 0.0, 1.0], [x - 1.0, 0.0, 1.0]])


FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_a_cut_out_is_the_picture_without_its_background():
    camera = Camera(
        np.array([0.0, -4.0, 0.0]), np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]).T, np.array([0.5, 0.5])
    )
    surfaces = [Surface(square(), FACES, (1.0, 0.0, 0.0))]
    found, picture = cut_out(surfaces, camera, 80, 60), draw(surfaces, camera, 80, 60)
    np.testing.assert_array_equal(np.unique(found[..., 3]), [0.0, 1.0])
    np.testing.assert_allclose(found[15:45, 20:60, :3], picture[15:45, 20:60], atol=1e-6)
    assert found[..., 3].sum() == 30 * 40
    half = cut_out([Surface(square(0.025), FACES, (1.0, 0.0, 0.0))], camera, 80, 60)
    assert half[30, 20, 3] == 0.5, "half a pixel is half opaque"
    np.testing.assert_allclose(half[30, 20, :3], found[30, 30, :3], atol=1e-6)


def test_colours_of_vertices_are_interpolated_and_broken_vertices_left_out():
    camera = Camera(
        np.array([0.0, -4.0, 0.0]), np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]).T, np.array([0.5, 0.5])
    )
    colours = np.array([[0.0, 0, 0], [0.6, 0, 0], [0.6, 0, 0], [0.0, 0, 0]])
    row = draw([Surface(square(), FACES, colours)], camera, 80, 60)[30, 20:60, 0]
    np.testing.assert_allclose(np.diff(row), np.diff(row)[0], atol=1e-5)
    assert row[-1] > 30 * row[0] > 0
    broken = square()
    broken[3] = np.nan
    picture = cut_out([Surface(broken, FACES, (1.0, 0.0, 0.0))], camera, 80, 60)
    assert 0.4 < picture[..., 3].sum() / (30 * 40) < 0.6, "one of two triangles"


def test_the_camera_follows_the_recorded_garment():
    """A square that flies away in a straight line stays where it is in the picture."""
    path = np.stack([square(0.5 * k) for k in range(100)])
    stage = Stage(path, 1 / 30, FACES, FACES, (1.0, 0.0, 0.0), height=40)
    body = square() - [0.0, -9.0, 9.0]
    pictures = [stage.picture(k, path[k], body + [0.5 * k, 0, 0])[..., 3] for k in (48, 52)]
    np.testing.assert_array_equal(*pictures)
    beside = stage.picture(48, path[48] + [0.5, 0, 0], body)[..., 3]
    assert (beside != pictures[0]).any(), "others are not followed"
    still = np.repeat(path[:1], 5, axis=0)
    np.testing.assert_allclose(smoothed(still[:, 0], 3.0), still[:, 0])


def test_errors_are_coloured_by_their_distance():
    path = np.repeat(square()[None], 2, axis=0)
    stage = Stage(path, 1 / 30, FACES, FACES, (1.0, 0.0, 0.0), height=40)
    body = square() + [0.0, 50.0, 50.0]
    right = stage.error_picture(1, path[1], body)[20, 15, :3] / 255.0
    wrong = stage.error_picture(1, path[1] + [0.0, 2 * MOST_ERROR, 0.0], body)[20, 15, :3] / 255.0
    np.testing.assert_allclose(right / right.max(), RIGHT / RIGHT.max(), atol=0.02)
    np.testing.assert_allclose(wrong / wrong.max(), WRONG / WRONG.max(), atol=0.02)


def test_clips_show_fifteen_pictures_a_second_at_most():
    assert list(shown_frames(7, 1 / 30)) == [0, 2, 4, 6]
    assert list(shown_frames(3, 1 / 10)) == [0, 1, 2]
    assert list(shown_frames(9, 1 / 60)) == [0, 4, 8]
