"""ColorVideoVDP behind a stub: the traps are handled before it is asked, and its absence is told."""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
import pytest

from maskfab.base.errors import JobError
from maskfab.base.model import Tiling
from maskfab.display import emitted_light, eye, pictures


class Stub(ModuleType):
    """Keeps what it is asked, and finds 10 minus the mean relative difference."""

    def __init__(self) -> None:
        super().__init__("pycvvdp")
        self.photometry: dict = {}
        self.geometry: dict = {}
        self.pictures: tuple = ()

    def vvdp_display_photo_eotf(self, peak, **how):
        self.photometry = {"peak": peak, **how}
        return "photometry"

    def vvdp_display_geometry(self, resolution, *, ppd):
        self.geometry = {"resolution": resolution, "ppd": ppd}
        return "geometry"

    def cvvdp(self, *, display_photometry, display_geometry):
        assert (display_photometry, display_geometry) == ("photometry", "geometry")
        return self

    def predict(self, test, reference, *, dim_order):
        assert dim_order == "HWC"
        self.pictures = test, reference
        return 10.0 - float(np.abs(test - reference).mean() / reference.mean()), {}


@pytest.fixture
def stub(monkeypatch):
    module = Stub()
    monkeypatch.setitem(sys.modules, "pycvvdp", module)
    return module


def quality(panel, image, viewing):
    perfect = emitted_light.series(emitted_light.ideal(image, 1, 84.67), viewing, eye.HIGHEST_CPD)
    shown = emitted_light.Tiled.of(panel, *image.shape[:2])
    return eye.jod(shown.series(image, viewing, eye.HIGHEST_CPD), perfect, viewing)


def test_an_even_field_reaches_the_metric_without_the_lattice_in_absolute_luminance(stub, slit_panel, telephone):
    panel = slit_panel(tiling=Tiling.PERIODIC, count=20)
    image = pictures.flat(20)
    found = quality(panel, image, telephone)
    assert found >= 9.99
    for picture in stub.pictures:
        assert picture.dtype == np.float32
        np.testing.assert_allclose(picture, 250.0, rtol=1e-5)  # half of 500 cd/m2
    assert stub.photometry["EOTF"] == "linear"
    assert stub.photometry["source_colorspace"] == "BT.709"
    samples = stub.pictures[0].shape[1] / 20
    assert stub.geometry["ppd"] == pytest.approx(samples * telephone.pixels_per_degree)
    assert stub.geometry["resolution"] == stub.pictures[0].shape[1::-1]


def test_nothing_is_clipped_and_nothing_is_negative(stub, slit_panel, telephone):
    image = pictures.edge(20)
    quality(slit_panel(count=20), image, telephone)
    brightest = max(picture.max() for picture in stub.pictures)
    assert stub.photometry["peak"] == pytest.approx(brightest)
    assert brightest > 500
    assert min(picture.min() for picture in stub.pictures) >= 0


def test_the_picture_stands_upright(stub, slit_panel, telephone):
    image = np.zeros((20, 20, 3))
    image[15:] = 1.0  # the upper quarter
    quality(slit_panel(count=20), image, telephone)
    for picture in stub.pictures:
        rows = picture.mean(axis=(1, 2))
        assert rows[: len(rows) // 4].mean() > 10 * rows[len(rows) // 2 : -2].mean()


def test_slow_light_passes_and_fine_light_does_not():
    gain = eye._fade(np.array([0.0, 39.9, 45.0, 50.0, 61.8]))
    np.testing.assert_allclose(gain, [1, 1, 0.5, 0, 0], atol=1e-12)


def test_a_judged_panel_has_the_number_if_it_is_asked_for(stub, slit_panel, telephone):
    images = {eye.FLAT: pictures.flat(10)}
    with_it = eye.judge("A", slit_panel(count=10), images, 6, telephone, with_jod=True)
    without = eye.judge("A", slit_panel(count=10), images, 6, telephone)
    assert {q.name for q in with_it.quantities} - {q.name for q in without.quantities} == {"flat_jod"}
    assert with_it.views[eye.FLAT].jod is not None


def test_who_has_it_not_is_told_what_to_install(monkeypatch, slit_panel, telephone):
    monkeypatch.setitem(sys.modules, "pycvvdp", None)
    with pytest.raises(JobError, match=r"MF152.*pip install .*\[eye\]'"):
        eye.judge("A", slit_panel(count=10), {eye.FLAT: pictures.flat(10)}, 6, telephone, with_jod=True)
