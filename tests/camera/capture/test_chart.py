"""Colours by a chart in a photograph, against charts that are painted with a known matrix."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from maskfab.base.errors import MaskfabError
from maskfab.camera.chart import chart_matrix, read_patches
from maskfab.camera.record import Noise, Record
from maskfab.optics.colour import lab_of_linear_srgb, linear_srgb_of_lab_d50

TRUE = np.array([[1.6, -0.4, -0.2], [-0.3, 1.5, -0.2], [0.0, -0.5, 1.5]])
PATCH, ACROSS = 24, 6


def colours(count=24, seed=0):
    """Greys and colours, linear sRGB."""
    found = np.random.default_rng(seed).uniform(0.03, 0.9, (count, 3))
    found[-6:] = np.geomspace(0.03, 0.9, 6)[:, None]
    return found


def table(path, numbers, header="row,column,size,red,green,blue"):
    path.write_text("\n".join([header, *(",".join(f"{each:.9g}" for each in row) for row in numbers)]) + "\n")
    return path


def placed(true):
    middle = [((k // ACROSS + 0.5) * PATCH - 0.5, (k % ACROSS + 0.5) * PATCH - 0.5, 12) for k in range(len(true))]
    return np.hstack([middle, true])


def painted(true, noise=0.0, ceiling=np.inf):
    """A photograph of the chart, in balanced colours, and its record."""
    seen = (true @ np.linalg.inv(TRUE).T).T.reshape(3, -1, ACROSS).astype(np.float32)
    light = seen.repeat(PATCH, axis=1).repeat(PATCH, axis=2)
    light = light + noise * np.random.default_rng(1).standard_normal(light.shape).astype(np.float32)
    return light, Record(light, Noise(1e4, 5.0), ceiling)


def fitted(tmp_path, numbers, light, record):
    return chart_matrix(read_patches(table(tmp_path / "chart.csv", numbers)), light, record, (1.0, 1.0, 1.0))


def test_the_matrix_of_a_painted_chart_is_found(tmp_path):
    found = fitted(tmp_path, placed(colours()), *painted(colours()))
    assert found.matrix == pytest.approx(TRUE, abs=1e-4)
    assert found.delta_e.max() < 0.02
    noisy = fitted(tmp_path, placed(colours()), *painted(colours(), 0.01))
    assert noisy.matrix == pytest.approx(TRUE, abs=0.02)


def test_a_wrong_reference_shows_in_the_difference_by_the_others(tmp_path):
    stated = colours()
    stated[3] = stated[3][::-1]
    found = fitted(tmp_path, placed(stated), *painted(colours()))
    assert found.delta_e_left_out.argmax() == 3
    assert found.delta_e_left_out[3] > found.delta_e[3] > 5


def test_full_and_dark_patches_are_told_and_not_used(tmp_path):
    true = colours()
    true[0], true[1] = 0.0, 3.0
    stated = placed(np.minimum(true, 2))
    found = fitted(tmp_path, stated, *painted(true, ceiling=1.5))
    assert found.left_out == ("patch 1 is dark", "patch 2 is full")
    assert found.matrix == pytest.approx(TRUE, abs=1e-3)


def test_binned_pixels_are_found_by_places_of_the_photograph(tmp_path):
    light, _ = painted(colours())
    means = light.reshape(3, light.shape[1] // 2, 2, -1, 2).mean(axis=(2, 4))
    patches = read_patches(table(tmp_path / "chart.csv", placed(colours())))
    found = chart_matrix(patches, means, Record(means, Noise(1e4, 5.0)), (1.0, 1.0, 1.0), 2)
    assert found.matrix == pytest.approx(TRUE, abs=1e-4)


def test_lab_against_d50_is_that_of_the_profile_connection_space(tmp_path):
    assert linear_srgb_of_lab_d50(np.array([[100.0, 0, 0], [50, 0, 0]])) == pytest.approx(
        np.array([[1.0] * 3, [((50 + 16) / 116) ** 3] * 3]), abs=1e-9
    )
    # Red of sRGB as its ICC profile states it, XYZ (0.4361, 0.2225, 0.0139) against D50.
    root = np.cbrt(np.array([0.4361, 0.2225, 0.0139]) / [0.9642, 1.0, 0.8249])
    lab = np.array([116 * root[1] - 16, 500 * (root[0] - root[1]), 200 * (root[1] - root[2])])
    assert linear_srgb_of_lab_d50(lab) == pytest.approx([1, 0, 0], abs=2e-3)
    read = read_patches(table(tmp_path / "lab.csv", [[9, 9, 8, *lab], [9, 9, 8, 50, 0, 0]], "row,column,size,L,a,b"))
    assert read.colours[0] == pytest.approx([1, 0, 0], abs=2e-3)


@settings(max_examples=50, deadline=None)
@given(arrays(np.float64, 3, elements=st.floats(0.001, 1)))
def test_lightness_against_d50_is_about_that_against_d65(rgb):
    """Bradford moves lightness of colours little, and greys not at all."""
    lab = lab_of_linear_srgb(rgb)
    assert abs(lab_of_linear_srgb(linear_srgb_of_lab_d50(lab)) - lab)[0] < 3


@pytest.mark.parametrize(
    ("code", "change"),
    [
        ("MF355", lambda numbers: numbers[:5]),
        ("MF355", lambda numbers: np.add(numbers, [[1000, 0, 0, 0, 0, 0]])),
        ("MF355", lambda numbers: numbers * [[1, 1, 0.1, 1, 1, 1]]),
        ("MF355", lambda numbers: numbers * [[1, 1, 1, 255, 255, 255]]),
        ("MF355", lambda numbers: np.vstack([numbers[-6:]] * 2)),
        ("MF303", lambda numbers: numbers * np.nan),
        ("MF303", lambda numbers: numbers[:, :5]),
    ],
    ids=["few", "outside", "small", "codes", "greys", "nan", "columns"],
)
def test_a_chart_that_tells_no_colours_is_refused(tmp_path, code, change):
    with pytest.raises(MaskfabError, match=code):
        fitted(tmp_path, change(placed(colours())), *painted(colours()))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("order", "words"),
    [
        ([0, 1, 3, 2, *range(4, 24)], "patches 3, 4 look exchanged"),
        (list(range(23, -1, -1)), "stands upside down"),
        ([row * ACROSS + ACROSS - 1 - column for row in range(4) for column in range(ACROSS)], "is mirrored"),
    ],
    ids=["swapped", "upside_down", "mirrored"],
)
def test_a_chart_that_is_read_in_another_order_is_refused(tmp_path, order, words, seed):
    true = colours(seed=seed)
    with pytest.raises(MaskfabError, match=f"MF356.*{words}"):
        fitted(tmp_path, placed(true[order]), *painted(true, 0.01))
    # A camera whose colours no matrix gives rightly is no chart in another order.
    bent, record = painted(true**1.15 * np.random.default_rng(seed).normal(1, 0.05, true.shape), 0.01)
    assert fitted(tmp_path, placed(true), bent, record).delta_e.mean() > 2


def test_names_of_columns_are_checked(tmp_path):
    patches = table(tmp_path / "chart.csv", placed(colours()), "row,column,size,r,g,b")
    with pytest.raises(MaskfabError, match="MF303"):
        read_patches(patches)
