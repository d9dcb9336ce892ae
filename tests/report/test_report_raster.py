from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.image import imread

from maskfab.base.model import Opening, Panel, Psf, Tiling
from maskfab.report.figures import sheet


def panel(orientation: int = 0, gutter_nm: int = 2000) -> Panel:
    mask = np.zeros((4, 4), dtype=bool)
    mask[0, 0] = True
    cells = np.full((6, 6), orientation, dtype=np.int8)
    return Panel(Opening("corner", mask, 8000), 8000, gutter_nm, cells, Tiling.PERIODIC, None)


@pytest.mark.parametrize("gutter_nm", [0, 2, 2000])
@pytest.mark.parametrize("pixels", [7, 50, 333])
def test_coverage_keeps_the_clear_area_exactly_on_any_pixel_grid(gutter_nm, pixels):
    drawn = panel(gutter_nm=gutter_nm)
    view = sheet.panel_coverage(drawn, 3 * drawn.pitch_nm, pixels)
    assert view.mean() == pytest.approx(drawn.open_ratio, rel=1e-12)
    assert view.min() >= 0
    assert view.max() <= 1 + 1e-12


def test_coverage_has_the_cells_as_the_panel_turns_them():
    upright = sheet.panel_coverage(panel(0, 0), 32_000, 4)
    assert upright[0, 0] == 1  # lower left
    mirrored = sheet.panel_coverage(panel(4, 0), 32_000, 4)
    assert mirrored[0, 3] == 1  # lower right


def test_view_beyond_the_panel_is_chrome():
    drawn = panel()
    view = sheet.panel_coverage(drawn, 12 * drawn.pitch_nm, 120)
    assert view.mean() == pytest.approx(drawn.open_ratio / 4, rel=1e-12)
    assert not view[61:].any()


def test_log_intensity_runs_from_the_peak_over_six_decades():
    values = np.array([[1e-9, 0, 0], [0, 5.0, 0.05], [0, 0, 5e-6]])
    log = sheet.log_intensity(Psf(values, 1.0, 530.0, "point"), 3)
    np.testing.assert_allclose(log, [[-6, -6, -6], [-6, 0, -2], [-6, -6, -6]], atol=1e-12)


def test_reduced_psf_keeps_every_order():
    values = np.full((401, 401), 1e-9)
    values[200, 200] = 1.0
    values[7, 388] = 1.0
    log = sheet.log_intensity(Psf(values, 1.0, 530.0, "point"), 101)
    assert log.shape == (101, 101)
    assert np.count_nonzero(log > -2) >= 2


def test_psf_of_nothing_is_black():
    assert (sheet.log_intensity(Psf(np.zeros((3, 3)), 1.0, 530.0, "point"), 3) == -sheet.DECADES).all()


def test_png_reads_back_with_its_lowest_row_at_the_bottom():
    levels = np.array([[0, 1, 2], [2, 1, 0]], dtype=np.uint8)
    palette = np.array([[0, 0, 0], [255, 0, 0], [0, 255, 255]], dtype=np.uint8)
    image = imread(io.BytesIO(sheet.png(levels, palette)), format="png")
    np.testing.assert_array_equal((image[::-1, :, :3] * 255).round(), palette[levels])
