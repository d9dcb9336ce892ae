"""Curves that were measured elsewhere: read as they are written, or refused."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.base.errors import MaskfabError
from maskfab.camera.inspection.edge_mtf import read_mtf


def test_frequencies_are_told_per_pixel_and_per_millimetre(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text("# by another program\ncycles/mm,mtf\n0,1\n100,0.5\n\n250,0.1\n", encoding="utf-8")
    curve = read_mtf(path, 2.0)
    np.testing.assert_allclose(curve.frequency_cy_per_px, [0, 0.2, 0.5])
    np.testing.assert_allclose(curve.frequency_cy_per_mm, [0, 100, 250])
    np.testing.assert_allclose(curve.mtf, [1, 0.5, 0.1])
    assert curve.low is None
    assert curve.high is None
    path.write_text("cycles/pixel, mtf, low, high\r\n0,1,1,1\r\n.5,.2,.1,.3\r\n", encoding="utf-8-sig")
    curve = read_mtf(path, 4.0)
    np.testing.assert_allclose(curve.frequency_cy_per_mm, [0, 125])
    np.testing.assert_allclose([curve.low, curve.high], [[1, 0.1], [1, 0.3]])


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("MF302", ""),
        ("MF302", "# only words\n"),
        ("MF303", "wavelength_nm,mtf\n0,1\n1,0\n"),
        ("MF303", "cycles/mm,sfr\n0,1\n1,0\n"),
        ("MF303", "cycles/mm,mtf\n0,1\n"),
        ("MF303", "cycles/mm,mtf\n0,1\n1,x\n"),
        ("MF303", "cycles/mm,mtf\n0,1\n1\n"),
        ("MF303", "cycles/mm,mtf\n1,1\n0,1\n"),
        ("MF303", "cycles/mm,mtf\n-1,1\n0,1\n"),
        ("MF303", "cycles/mm,mtf\n0,1\nnan,1\n"),
        ("MF104", "cycles/mm,mtf\n0,100\n1,50\n"),
        ("MF104", "cycles/mm,mtf\n0,1\n1,-0.1\n"),
        ("MF104", "cycles/mm,mtf\n0,1\n1,nan\n"),
        ("MF104", "cycles/mm,mtf,low,high\n0,1,1,1\n1,.5,.6,.7\n"),
    ],
)
def test_what_is_no_curve_is_refused(tmp_path, code, text):
    path = tmp_path / "curve.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(MaskfabError) as caught:
        read_mtf(path, 2.0)
    assert caught.value.code == code, caught.value
    assert "wavelength" not in caught.value.cure


def test_a_file_of_another_kind_is_refused(tmp_path):
    for name, content, code in (
        ("curve.txt", b"", "MF308"),
        ("none.csv", None, "MF301"),
        ("c.csv", b"\xff\xfe", "MF304"),
    ):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(MaskfabError) as caught:
            read_mtf(tmp_path / name, 2.0)
        assert caught.value.code == code
