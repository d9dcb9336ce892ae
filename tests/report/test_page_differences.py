"""A page's photographs made again: another draw of their noise is none of a forger's pictures."""

from __future__ import annotations

import json

import numpy as np
import pytest

from maskfab.camera.scores import Score, Shot
from maskfab.findings.photographs import Restored
from maskfab.report.figures import scene
from maskfab.report.pages import differences as page
from maskfab.runs.verification import _reported

RNG = np.random.default_rng(11)
TRUTH = np.kron(RNG.random((3, 9, 12)), np.ones((16, 16))).astype(np.float32)
GRAIN = 0.08


def photographed(
    *, truth: np.ndarray = TRUTH, seen: np.ndarray = TRUTH, seed: int = 1, psnr: float = 22.0, grain: float = GRAIN
) -> Restored:
    noise = grain * np.random.default_rng(seed).standard_normal(TRUTH.shape)
    picture = (0.1 + 0.8 * seen + noise).astype(np.float32)
    return Restored(
        (), (), None, "leaves1", truth, (Shot(Score("A", 24, "leaves1", 0.1, psnr, 0.9, psnr, 0.9), picture),)
    )


def compared(forged: Restored) -> list[str]:
    pages = [scene.truth(each) | scene.photograph_pictures(each) for each in (forged, photographed())]
    then, now = ("<p>photographs</p>".join(each.values()) for each in pages)
    return list(page.differences(then, now, {"A": pages[1]}))


def test_the_same_photograph_in_other_noise_is_told_as_noise():
    assert compared(photographed()) == []
    assert compared(photographed(seed=2, psnr=22.03)) == [page.NOISE]


def other_patch(part: slice) -> np.ndarray:
    changed = TRUTH.copy()
    changed[:, part, part] = 1 - changed[:, part, part]
    return changed


@pytest.mark.parametrize(
    "forged",
    [
        photographed(seen=TRUTH[:, ::-1], seed=2),
        photographed(seen=other_patch(slice(64, 96)), seed=2),
        photographed(seed=2, psnr=25.0),
        photographed(seen=0.8 * TRUTH, seed=2),
        photographed(grain=0.0),
        photographed(grain=0.8 * GRAIN, seed=2),
    ],
    ids=["another scene", "a part of it", "a better number", "darker", "no noise", "less noise"],
)
def test_another_photograph_is_named(forged):
    assert compared(forged) == ["A design_24"]


@pytest.mark.parametrize(
    ("key", "by", "told"),
    [
        ("psnr", 0.02, False),
        ("psnr", 1.0, True),
        ("psnr_inner", -0.5, True),
        ("epsilon", 0.02, False),
        ("epsilon", 1, True),
    ],
)
def test_numbers_of_photographs_are_compared_within_their_noise(tmp_path, key, by, told):
    def report(changed: float) -> dict:
        numbers = {"psnr": 22.0, "psnr_inner": 23.0, "epsilon": 0.05}
        numbers[key] += changed
        design = {"scene": "leaves1", "levels": [{"level_db": 24, "photograph": numbers}]}
        return {"schema_version": 3, "dies": [{"name": "A", "design": design}]}

    (tmp_path / "report.json").write_text(json.dumps(report(by)), encoding="utf-8")
    found = [check for check in _reported(tmp_path, report(0.0)) if not check.passed]
    assert [check.name for check in found] == (["reported", "reported_differences"] if told else [])
    if told:
        assert f"photograph, {key}" in found[0].method


def test_the_scene_itself_has_no_noise():
    assert compared(photographed(truth=other_patch(slice(0, 8)))) == ["A front_truth"]
    grain = np.clip(TRUTH + GRAIN * RNG.standard_normal(TRUTH.shape), 0, 1).astype(np.float32)
    assert compared(photographed(truth=grain)) == ["A front_truth"]
