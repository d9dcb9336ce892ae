"""The protocol on small scenes: fair, repeatable, and it prefers what must be better."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from once import leaves as drawn
from OpenImageIO import ImageSpec

from maskfab.base.errors import JobError, SourceError
from maskfab.base.pictures import write_image
from maskfab.camera.imaging import Isoplanatic
from maskfab.camera.protocol import EPSILONS, STRENGTHS, Protocol, evaluate
from maskfab.camera.scenes import dead_leaves, folder, indoors, scene
from maskfab.camera.stop_cells import CELLS, lay
from maskfab.job.camera import Sensor
from maskfab.mask.formats.exr import write_exr, write_png

ONE = np.zeros((CELLS, CELLS), dtype=np.int8)


@pytest.fixture(scope="module")
def leaves():
    return tuple(drawn(seed, 832, 832) for seed in (1, 2))


@pytest.fixture(scope="module")
def table(leaves):
    slit, bar = np.zeros((2, 21, 21), dtype=np.bool_)
    slit[:, 5:10] = True
    bar[:6, :17] = True
    designs = [lay("slit", slit, ONE), lay("bar", bar), lay("open", np.ones_like(bar))]
    return evaluate(designs, leaves, leaves[:1], (32,))


def test_the_open_stop_beats_the_bar_and_the_bar_beats_the_slit(table):
    gains = {g.design: g for g in table.gains("slit")}
    assert gains["open"].psnr.mean > gains["bar"].psnr.mean > 1
    assert gains["bar"].psnr.half_width > 0
    assert gains["bar"].ssim.mean > 0


def test_the_table_holds_every_case(table):
    assert len(table.scores) == 6
    assert all(s.epsilon in EPSILONS and 0 < s.ssim < 1 and s.psnr > 10 for s in table.scores)


def test_the_same_again(leaves):
    bar = np.zeros((21, 21), dtype=np.bool_)
    bar[:6, :17] = True
    design = lay("bar", bar)
    first, again = (evaluate([design], leaves[:1], leaves[:1], (24,)) for _ in range(2))
    assert first == again
    twin = evaluate([design, lay("twin", bar)], leaves[:1], leaves[:1], (24,)).gains("bar")[0]
    assert twin.psnr.mean == 0
    assert twin.psnr.tie
    assert math.isnan(twin.psnr.half_width)


def test_scenes_follow_their_seed():
    a, b, c = (dead_leaves(seed, 192, 256).values for seed in (3, 3, 4))
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, c)


def test_pictures_are_cut_to_their_middle():
    values = np.zeros((1100, 2048), dtype=np.float32)
    values[38:1062, 256:1792] = 1
    found = scene("7", values)
    assert found.values.shape == (3, 1024, 1536)
    assert found.number == 7
    assert (found.values == 1).all()
    assert scene("tall", np.zeros((2000, 900, 3), dtype=np.float32)).values.shape == (3, 1536, 896)


@pytest.mark.parametrize("values", [np.zeros((500, 2000)), np.full((900, 900), 2.0), np.full((900, 900), np.nan)])
def test_pictures_that_do_not_serve_are_refused(values):
    with pytest.raises(JobError, match="MF121"):
        scene("bad", values)


def test_a_folder_without_photographs_is_refused(tmp_path):
    with pytest.raises(SourceError, match="MF301"):
        folder(tmp_path)


def test_a_folder_takes_light_too_and_names_what_it_skips(tmp_path):
    light = leaves_light()
    write_exr(light, tmp_path / "bright.exr", {})
    write_png(light, tmp_path / "coded.png")
    (tmp_path / "notes.txt").write_text("nothing")
    (tmp_path / ".hidden").write_text("nothing")
    found = folder(tmp_path)
    assert found.skipped == ("notes.txt",)
    bright, coded = found.photographs
    np.testing.assert_allclose(bright.light, light[:, ::-1], rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(coded.light, light[:, ::-1], atol=0.01)
    np.testing.assert_allclose(bright.values, coded.values, atol=0.004)


def leaves_light():
    """Linear light within 0 to 1, row 0 the lowest."""
    return np.random.default_rng(0).uniform(0, 1, (3, 832, 896))


@pytest.mark.parametrize(("most", "least"), [(3.0, 0.0), (1.0, -0.5), (np.inf, 0.0), (np.nan, 0.0)])
def test_light_that_no_white_is_stated_for_is_refused(tmp_path, most, least):
    light = leaves_light()
    light[0, 5, 5], light[1, 6, 6] = most, least
    write_exr(light, tmp_path / "a.exr", {})
    with pytest.raises(JobError, match="MF121"):
        folder(tmp_path)
    if most == 3.0:
        (found,) = folder(tmp_path, white=1.5).photographs
        assert found.light.max() == pytest.approx(2.0, rel=1e-3)
        assert found.values.max() == pytest.approx(1, abs=1e-6)


def test_a_white_of_one_is_stated_and_leaves_highlights_that_brackets_take(tmp_path):
    light = leaves_light()
    light[0, 5, 5] = 40
    write_exr(light, tmp_path / "a.exr", {})
    (found,) = folder(tmp_path, white=1.0).photographs
    np.testing.assert_allclose(found.light, light[:, ::-1], rtol=1e-3, atol=1e-6)
    Protocol("camera", brackets=(1, 16)).check(found)


def test_the_cure_for_light_above_white_serves_with_highlights_and_without(tmp_path):
    light = leaves_light()
    light[0, 5, 5] = 40
    write_exr(light, tmp_path / "a.exr", {})
    with pytest.raises(JobError) as refused:
        folder(tmp_path)
    cure = str(refused.value.cure)
    most = float(re.search(r"--white: ([\d.]+) if nothing is brighter than white; less, if", cure)[1])
    brackets = Protocol("camera", brackets=(1, 16))
    (even,) = folder(tmp_path, white=most).photographs
    (lit,) = folder(tmp_path, white=most / 2).photographs
    with pytest.raises(JobError, match="MF143"):
        brackets.check(even)
    brackets.check(lit)


def test_a_transparent_picture_is_refused(tmp_path):
    pixels = np.full((840, 840, 4), 255, dtype=np.uint8)
    header = ImageSpec(840, 840, 4, "uint8")
    write_image(pixels, header, tmp_path / "a.png")
    assert folder(tmp_path).photographs[0].values.min() == 1
    pixels[3, 3, 3] = 10
    write_image(pixels, header, tmp_path / "a.png")
    with pytest.raises(JobError, match="transparent"):
        folder(tmp_path)


def test_another_protocol_in_code_values_is_f1_but_for_its_draw_of_noise(leaves, table):
    bar = np.zeros((21, 21), dtype=np.bool_)
    bar[:6, :17] = True
    (found,) = evaluate([lay("bar", bar)], leaves[:1], leaves[:1], (32,), protocol=Protocol("own", linear=False)).scores
    (known,) = [each for each in table.scores if (each.design, each.scene) == ("bar", leaves[0].name)]
    assert found.psnr == pytest.approx(known.psnr, abs=0.02)
    assert found.psnr != known.psnr


def test_linear_light_is_scored_as_it_is_shown(leaves):
    """Without noise to speak of and without blur the code values come back whatever light stands for them."""
    kind = Protocol("deep", Sensor(full_well=1e9, read_noise=0.0))
    (found,) = evaluate([_Clear("clear")], leaves[:1], leaves[:1], (70,), protocol=kind).scores
    assert found.psnr > 45


def test_little_light_asks_for_more_than_the_largest_strength_of_f1(leaves):
    """Of dim scenes at 16 dB that largest one restores a decibel worse than the best, which is no end of the grid."""
    bar = np.zeros((21, 21), dtype=np.bool_)
    bar[:6, :17] = True
    scene = [indoors(leaves[1])]
    wide, narrow = (
        evaluate([lay("bar", bar)], scene, scene, (16,), protocol=kind, details=False).scores[0]
        for kind in (Protocol("wide"), Protocol("narrow", strengths=EPSILONS))
    )
    assert EPSILONS[-1] < wide.epsilon < STRENGTHS[-1]
    assert wide.psnr > narrow.psnr + 1


class _Clear(Isoplanatic):
    transmission = 0.2072

    def _transfer(self, shape):
        return np.ones((3, shape[0], shape[1] // 2 + 1), dtype=np.float32)


def test_bad_studies_are_refused_before_any_work(leaves, table):
    design = lay("a", np.ones((21, 21), dtype=np.bool_))
    for designs, test, tuning, levels, code in (
        ([], leaves, leaves, (32,), "MF105"),
        ([design, design], leaves, leaves, (32,), "MF105"),
        ([design], (), leaves, (32,), "MF105"),
        ([design], leaves, (), (32,), "MF105"),
        ([design], leaves, leaves, (45,), "MF141"),
        ([design], leaves, leaves, (32, 0), "MF141"),
    ):
        with pytest.raises(JobError, match=code):
            evaluate(designs, test, tuning, levels)
