"""What is kept of the bundled scenes is what they have, and spares drawing them."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.camera import scenes
from maskfab.camera.scenes import bundled
from maskfab.camera.stop_cells import lattice
from maskfab.designs.model.expected_psnr import surrogate_behind
from maskfab.designs.model.statistics import KEPT, SceneStatistics, scene_statistics
from maskfab.designs.search.result import run_key
from maskfab.job.sections import SearchSection


def _agrees(count: int, leak_scenes: int) -> None:
    kept = scene_statistics(bundled(count), leak_scenes=leak_scenes)
    anew = SceneStatistics.of(tuple(bundled(count)), leak_scenes=leak_scenes)
    assert (kept.noise.shot, kept.factor, kept.power) == pytest.approx(
        (anew.noise.shot, anew.factor, anew.power), rel=1e-6
    )
    assert kept.low.shape == anew.low.shape
    assert kept.low.dtype == np.complex64
    assert abs(kept.low - anew.low).max() <= 1e-6 * abs(anew.low).max()
    assert np.allclose(kept.low_truth, anew.low_truth, atol=1e-6)


def test_statistics_that_are_kept_are_those_of_the_scenes() -> None:
    _agrees(4, 2)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "leak_scenes"), KEPT[1:])
def test_statistics_of_sixteen_scenes_are_those_of_the_scenes(count: int, leak_scenes: int) -> None:
    _agrees(count, leak_scenes)


def test_no_bundled_scene_is_drawn_for_openings_that_are_compared_by_f1(monkeypatch: pytest.MonkeyPatch) -> None:
    def drawn(*_: object) -> None:
        raise AssertionError("a scene was drawn")

    monkeypatch.setattr(scenes, "dead_leaves", drawn)
    unit = np.zeros((7, 7), dtype=np.bool_)
    unit[1:5, 2:5] = True
    levels = [surrogate_behind(bundled(count), lattice(7, 24_000), leak_scenes=most)(unit) for count, most in KEPT]
    assert all(20 < low < middle < high < 45 for low, middle, high in levels)
    section = SearchSection(name="x", dots=7, pitch="168 um", clear_dots=12)
    assert run_key(section, bundled(4)) != run_key(section, bundled(16))


def test_scenes_that_are_asked_for_are_drawn_once() -> None:
    few = bundled(3)
    assert len(few) == 3
    assert few[1] is few[-2]
    assert [each.name for each in few[:2]] == ["leaves1", "leaves2_dim"]
    with pytest.raises(IndexError):
        few[3]
