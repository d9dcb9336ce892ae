"""Small photographs: 128 pixels of scene round the sensor, and what comes from beyond them is bounded and told."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import scipy.fft

from maskfab.api.photographs import simulate
from maskfab.base.errors import JobError
from maskfab.camera.imaging import Isoplanatic, Margin, RestoredBy
from maskfab.camera.learning import mirrored
from maskfab.camera.protocol import F1
from maskfab.camera.scenes import Photograph, beyond, folder, messages, scene
from maskfab.camera.scores import Crop
from maskfab.camera.stop_cells import lay
from maskfab.findings.study import made, planned
from maskfab.mask.formats.exr import write_exr
from maskfab.mask.job import load_job

BAR = np.zeros((21, 21), dtype=np.bool_)
BAR[:6, :17] = True
SMALL, LARGE = Margin((512, 768), 128), Margin((832, 1088))


@dataclass(frozen=True, eq=False)
class Ghosts(Isoplanatic):
    """A point, and a share of its light that falls some columns to its left and right, half each."""

    share: float
    columns: int

    @property
    def transmission(self):
        return 0.2

    def _transfer(self, shape):
        across = np.cos(2 * np.pi * self.columns * scipy.fft.rfftfreq(shape[1]))
        found = 1 - self.share + self.share * across
        return np.broadcast_to(found, (3, shape[0], found.size)).astype(np.float32)


def picture(rows, columns):
    return scene("small", np.random.default_rng(1).random((rows, columns, 3), dtype=np.float32), 1)


def test_surroundings_are_as_wide_as_they_were_but_for_photographs_that_were_refused():
    taken = [picture(*shape) for shape in ((512, 768), (831, 2000), (832, 1088))]
    margins = [each.margin for each in (*taken, mirrored(taken[0], 2), taken[0].middle)]
    assert [margin.width for margin in margins] == [128, 128, 256, 128, 128]
    assert [margin.shape for margin in margins[:3]] == [(512, 768), (768, 1536), (832, 1088)]
    with pytest.raises(JobError, match=r"MF121 the picture has 768 x 511 pixels, fewer than 512 along a side"):
        scene("a", np.zeros((511, 768), dtype=np.float32))


@pytest.mark.parametrize(("columns", "expected"), [(1, 0.0), (128, 0.0), (129, 0.4), (200, 0.4)])
def test_what_falls_farther_than_the_surroundings_is_what_was_put_there(columns, expected):
    assert beyond(Ghosts("ghosts", 0.4, columns), SMALL) == pytest.approx(expected, abs=1e-5)


def test_light_from_beyond_is_missed_by_no_more_than_is_told():
    """A scene that is dark but for what lies outside the small one cut from it, where that sees nothing."""
    design, values = lay("bar", BAR), np.ones((3, *LARGE.shape), dtype=np.float32)
    top, left = ((large - small) // 2 for large, small in zip(LARGE.shape, SMALL.shape, strict=True))
    values[:, top:-top, left:-left] = 0
    light, nothing = (
        F1.seen(design, Photograph("x", 1, each, around=around))
        for each, around in ((values, 256), (values[:, top:-top, left:-left], 128))
    )
    rows, columns = nothing.shape[1:]
    missed, share = float(Crop(rows, columns).of(light).max()), beyond(design, SMALL)
    assert abs(nothing).max() < 1e-6
    assert share / 4 < missed < share < 0.5


def test_it_is_told_of_small_photographs_alone_and_by_what_is_seen():
    near, far = Ghosts("near", 0.3, 5), Ghosts("far", 0.3, 150)
    assert messages(far, [picture(832, 832)]) == ()
    (sentence,) = messages(far, [picture(832, 832), picture(512, 768)])
    assert "small has 768 x 512 pixels, 128 of them round the sensor rather than 256: 30.0% of" in sentence
    assert "0.0%" in messages(RestoredBy(near, far), [picture(512, 768)])[0]


def test_a_photograph_smaller_than_the_point_spread_is_refused():
    with pytest.raises(
        JobError, match=r"MF121.*60\.0% of a point's light falls farther behind far; the limit is 50%.*832"
    ):
        messages(Ghosts("far", 0.6, 150), [picture(512, 768)])
    assert messages(Ghosts("far", 0.6, 150), [picture(832, 832)]) == ()


@pytest.fixture
def highlights(tmp_path):
    """A folder with 576 x 512 pixels of light up to 3."""
    (tmp_path / "folder").mkdir()
    light = picture(512, 576).values.copy()
    light[:, 250:260, 200:220] = 3
    write_exr(light, tmp_path / "folder" / "lamps.exr", {})
    return tmp_path / "folder"


STUDY = f"""
[job]
name = "SMALL"
title = "SMALL SCENES"
[camera]
focal = "10 mm"
stop = {{ shape = "circle", diameter = "4 mm" }}
wavelengths = ["610 nm", "530 nm", "470 nm"]
pixel = "2 um"
window = "128 um"
[plate]
blank = "5 in"
writable = "100 mm"
die_size = "8.4 mm"
die_pitch = "22 mm"
columns = 1
[[die]]
name = "TOLED"
label = "T-OLED"
opening = "{(Path(__file__).parents[2] / "layouts/openings/toled.toml").as_posix()}"
dot = "8 um"
tiling = "periodic"
[[study.case]]
name = "merged"
brackets = [1, 16]
[study]
figure = "small"
title = "Small scenes"
protocols = ["camera"]
levels = [40]
axis = "case"
scenes = 0
"""


def test_brackets_of_a_small_photograph_are_taken_and_tell_what_comes_from_beyond(highlights, tmp_path):
    job = tmp_path / "job.toml"
    job.write_text(STUDY)
    found = simulate(job, images=highlights, white=1.5, levels=[40], brackets=[1, 16], pictures=True)
    (score,), (sentence,) = found.table.scores, found.left_out["TOLED"]
    assert score.psnr > 5
    assert "the scene lamps has 576 x 512 pixels, 128 of them round the sensor" in sentence
    assert sentence in str(found)
    assert found.shown["TOLED"][0].picture.shape == (3, 160, 200)
    study = made(planned(load_job(job), folder(highlights, 1.5)))
    ((take, (same,)),) = study.scores.items()
    assert same.psnr == score.psnr
    assert study.left_out["camera", "merged", "TOLED"] == (sentence,)
    assert take.case == "merged"
