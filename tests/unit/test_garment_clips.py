"""Films of recorded garments: each kind has its lane, and what is there is not rendered again."""

from __future__ import annotations

import pytest
from PIL import Image

from drape.data.hdf5 import GarmentFile
from drape.report.garment_clips import render_garment_clips
from tests import garments

pytestmark = pytest.mark.blender


def test_a_lane_for_each_kind_that_moves(tmp_path):
    """Two kinds, frames 0, 2 and 4 of 5: three pictures side by side; the second call renders nothing."""
    file = GarmentFile(garments.write(tmp_path / "tubes.h5"))
    together, *films = render_garment_clips(file, samples=1, size=[32, 48], every=2)
    assert together == tmp_path / "tubes_clips" / "garments.webp"
    assert sorted(film.parent.name for film in films) == ["dress", "skirt"]
    with Image.open(together) as picture:
        assert (picture.size, picture.n_frames) == ((64, 48), 3)
        shown = []
        for frame in range(3):
            picture.seek(frame)
            shown.append(picture.convert("RGB").tobytes())
    assert len(set(shown)) == 3
    before = {film: film.stat().st_mtime_ns for film in films}
    render_garment_clips(file, samples=1, size=[32, 48], every=2)
    assert before == {film: film.stat().st_mtime_ns for film in films}
