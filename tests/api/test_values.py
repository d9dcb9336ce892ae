"""Values as users of Python write them: any wavelength, numbers without a unit, arrays in and out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import maskfab as mf
from maskfab.api.lengths import USUAL, length_text, wavelength_text
from maskfab.base.errors import InputError, JobError
from maskfab.base.model import Quantity
from maskfab.base.units import UM_PER_UNIT, parse_length_um
from maskfab.optics.pupil import cut
from maskfab.report.text import Quantities

BAR = mf.Opening.bar(dots=7, size=(5, 3), pitch="56 um")
PANEL = mf.Panel.tile(BAR, "random", seed=1, size="560 um")
LOOK: dict[str, Any] = {"stop": "400 um", "pixel": "2 um", "window": "64 um"}
CAMERA = mf.Camera("5 mm", **LOOK)


def test_several_wavelengths_give_what_each_alone_gives_at_common_samples() -> None:
    """Announced or not, text or number; numbers agree within their own error."""
    lines = ["555 nm", 610, np.float64(480.5), 0.0005 * 1e6]
    many = CAMERA.psf(PANEL, lines)
    assert [psf.wavelength_nm for psf in many] == [555, 610, 480.5, 500]
    for line, psf in zip(lines, many, strict=True):
        alone = CAMERA.psf(PANEL, line)
        assert alone.step_um == psf.step_um
        np.testing.assert_allclose(psf, alone, atol=1e-12 * alone.samples.max())
    for line, mtf in zip(lines, CAMERA.mtf(PANEL, tuple(lines)), strict=True):
        alone = CAMERA.mtf(PANEL, line)
        error = alone.uncertainty + mtf.uncertainty
        np.testing.assert_allclose(mtf.cuts["radial_mean"], alone.cuts["radial_mean"], atol=error)
    assert CAMERA.wavelengths == (610, 530, 470)
    assert [psf.wavelength_nm for psf in CAMERA.psf(PANEL, CAMERA.wavelengths)] == [610, 530, 470]


def test_a_shorter_wavelength_than_the_cameras_gets_closer_samples() -> None:
    look = LOOK | {"pixel": "2.4 um"}
    camera = mf.Camera("5 mm", **look)
    near, far = camera.psf(PANEL, 400), camera.psf(PANEL, 470)
    announced = mf.Camera("5 mm", **look, wavelengths=[400, 610, 530, 470]).psf(PANEL, 400)
    assert near.step_um == announced.step_um < far.step_um
    np.testing.assert_array_equal(near, announced)
    assert [psf.step_um for psf in camera.psf(PANEL, np.array([400, 470]), pixels=True)] == [2.4, 2.4]


def test_a_panel_is_made_ready_once_and_no_answer_is_anothers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Called again, in any order, every panel behind every lens gives the bytes of its first call."""
    cuts = []
    monkeypatch.setattr("maskfab.optics.pupil.cut", lambda *given, real=cut: cuts.append(given) or real(*given))
    panels = [mf.Panel.tile(BAR, "random", seed=seed, size="560 um") for seed in (3, 4)]
    cameras = [mf.Camera("5 mm", **look) for look in (LOOK, LOOK | {"stop": "300 um"})]
    asked = [(camera, panel) for camera in cameras for panel in panels]
    first = [camera.psf(panel, 530).samples for camera, panel in asked]
    again = [camera.psf(panel, 530).samples for camera, panel in reversed(asked)]
    assert len(cuts) == len(asked)
    for one, other in zip(first, reversed(again), strict=True):
        np.testing.assert_array_equal(one, other)
    assert len({values.tobytes() for values in first}) == len(asked)
    monkeypatch.setattr("maskfab.api.camera._MOST_KEPT", 100)
    np.testing.assert_array_equal(cameras[0].psf(panels[0], 530), first[0])
    assert len(cuts) == len(asked) + 1


@pytest.mark.parametrize(
    ("asked", "code", "told"),
    [
        ("530", "MF103", 'such as "530 nm"'),
        (0.53, "MF156", "'0.53 um'"),
        (5.3e-7, "MF156", "'5.3e-07 m'"),
        (5300, "MF156", '"530 nm"'),
        ("555 um", "MF112", "outside 200 nm to 2000 nm"),
        ([530, float("nan")], "MF104", r"wavelength\[1\]"),
        ([530, -470], "MF104", r"wavelength\[1\]"),
        (np.ones((2, 2)), "MF105", r"\(2, 2\)"),
        (np.array([]), "MF105", "empty"),
        ([True], "MF103", "True"),
        ([[530, 470]], "MF103", "470"),
        ({530}, "MF105", "set"),
        (None, "MF105", "camera.wavelengths"),
    ],
)
def test_what_is_no_wavelength_is_refused_with_the_likely_meaning(asked: Any, code: str, told: str) -> None:
    for ask in (CAMERA.psf, CAMERA.mtf):
        with pytest.raises(JobError, match=told) as refusal:
            ask(PANEL, asked)
        assert refusal.value.code == code


def test_a_number_that_is_right_in_another_unit_is_refused_with_that_unit() -> None:
    """Every usual length, written in the units of a careless caller."""
    for of, usual in USUAL.items():
        right = parse_length_um(usual.example)
        parse, scale = (
            (wavelength_text, 1e3) if of == "wavelength" else (lambda number, of=of: length_text(number, of), 1)
        )
        assert str(parse(right * scale)).split()[0] == f"{right * scale:g}"
        for unit in ("mm", "m"):
            number = right / UM_PER_UNIT[unit]
            if usual.holds(number, "nm" if of == "wavelength" else "um"):
                continue
            with pytest.raises(JobError, match=rf"MF156 .*did you mean '{number:g} ") as refusal:
                parse(number)
            assert usual.name in refusal.value.what


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: mf.Camera(5.6, stop=2, pixel=1), "5.6 um .*did you mean '5.6 mm'"),
        (lambda: mf.Camera("5.6 um", stop="2 um", pixel=1), "5.6 um .*did you mean '5.6 mm'"),
        (lambda: mf.Camera("5.6 mm", stop=2, pixel=1), "stop of 2 um .*'2 mm'"),
        (lambda: mf.Camera("5.6 mm", stop={"shape": "square", "diameter": 2}, pixel=1), "stop of 2 um .*'2 mm'"),
        (lambda: mf.Camera("5.6 mm", stop="2 mm", pixel=2e-6), "pixel of 2e-06 um .*'2e-06 m'"),
        (lambda: mf.Opening.bar(dots=21, size=(15, 7), pitch=0.168), "pitch of 0.168 um .*'0.168 mm'"),
        (lambda: mf.Panel.tile(BAR, size=4.4), "panel of 4.4 um .*'4.4 mm'"),
        (lambda: mf.Plate.of(A=PANEL, blank=127), "blank of 127 um .*'127 mm'"),
        (lambda: mf.design(dots=7, pitch=0.056, clear_dots=9), "pitch of 0.056 um .*'0.056 mm'"),
    ],
)
def test_every_way_in_asks_whether_another_unit_was_meant(call: Callable[[], Any], told: str) -> None:
    with pytest.raises(JobError, match=f"MF156 .*{told}"):
        call()


def test_results_are_arrays_of_numpy() -> None:
    psf = CAMERA.psf(PANEL, 530)
    array = np.asarray(psf)
    assert (array.dtype, array.shape) == (np.float64, (len(psf.x_um), len(psf.y_um)))
    assert np.asarray(psf, dtype=np.float32).dtype == np.float32
    changed = np.array(psf)
    changed[0] = 0  # a copy, where the result itself is not to be changed
    assert np.asarray(BAR).dtype == np.bool_
    assert mf.Opening.of(np.asarray(BAR), pitch="56 um").clear_dots == BAR.clear_dots == np.count_nonzero(BAR)


def test_curves_are_tables_of_pandas(monkeypatch: pytest.MonkeyPatch) -> None:
    """Columns of equal length, whose values are those of the result."""
    made: list[dict[Any, Any]] = []

    class Frame(SimpleNamespace):
        def __init__(self, columns: Any) -> None:
            made.append(columns)

        def rename_axis(self, **names: str) -> dict[str, str]:
            return names

    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=Frame))
    psf, mtf = CAMERA.psf(PANEL, 530), CAMERA.mtf(PANEL, 530)
    assert psf.to_dataframe() == {"index": "y_um", "columns": "x_um"}
    mtf.to_dataframe()
    of_psf, of_mtf = made
    np.testing.assert_array_equal(np.column_stack(list(of_psf.values())), psf)
    assert list(of_psf) == psf.x_um.tolist()
    assert next(iter(of_mtf)) == "frequency_cy_per_mm"
    np.testing.assert_array_equal(of_mtf["radial_mean"], mtf.cuts["radial_mean"])
    assert set(of_mtf["wavelength_nm"]) == {530}


GREY = np.linspace(0, 1, 49).reshape(7, 7)


def test_a_grey_array_needs_a_threshold_from_which_on_a_dot_is_clear() -> None:
    for tell in (lambda: mf.Opening.of(GREY, "56 um"), lambda: mf.Panel.tile(GREY, pitch="56 um", size="560 um")):
        with pytest.raises(InputError, match=r"MF202 the array is grey: 47 of its 49 .*threshold=0\.5"):
            tell()
    for threshold in (0.25, 0.5, 1.0):
        opening = mf.Opening.of(GREY, "56 um", threshold=threshold)
        np.testing.assert_array_equal(opening.mask, threshold <= GREY)
        panel = mf.Panel.tile(GREY, pitch="56 um", size="560 um", threshold=threshold, name="grey")
        np.testing.assert_array_equal(panel.opening.mask, opening.mask)
        assert panel.held[0].name == "grey"
    with pytest.raises(InputError, match=r"threshold=128"):
        mf.Opening.of(np.array([[0, 256], [3, 0]], dtype=np.uint16), "16 um")


@pytest.mark.parametrize(
    ("array", "code", "told"),
    [
        (np.full((3, 3), np.nan), "MF202", "not finite"),
        (np.ones((3, 3), dtype=complex), "MF202", "modulus"),
        (np.full((3, 3), None), "MF202", "type object"),
        (np.zeros((0, 0)), "MF201", r"\(0, 0\)"),
        (np.ones((3, 3, 3)), "MF201", r"\(3, 3, 3\)"),
        ([[1, 0], [1]], "MF201", "differ in length"),
        (np.ones((3, 4)), "MF201", "3 rows of 4"),
    ],
)
def test_an_array_that_is_no_opening_is_refused(array: Any, code: str, told: str) -> None:
    for threshold in (None, 0.5):
        with pytest.raises(InputError, match=told) as refusal:
            mf.Opening.of(array, "16 um", threshold=threshold)
        assert refusal.value.code == code


SINGLE = mf.Camera("5 mm", **LOOK, wavelengths="530 nm")


@pytest.mark.parametrize(
    ("values", "shown", "lines"),
    [
        (["450 nm", 550], ["450 nm", "550 nm"], [450, 550]),
        ([["450 nm"], ["550 nm"]], ["450 nm", "550 nm"], [450, 550]),
        (np.linspace(450, 650, 3), ["450 nm", "550 nm", "650 nm"], [450, 550, 650]),
        ([np.array([450, 550]), (610,)], ["450 nm, 550 nm", "610 nm"], [450, 550, 610]),
        ({"from": 450, "to": 550, "count": 2}, ["450 nm", "550 nm"], [450, 550]),
    ],
)
def test_a_sweep_takes_lists_and_arrays_of_wavelengths(values: Any, shown: list[str], lines: list[float]) -> None:
    swept = mf.sweep(PANEL, SINGLE, over={"camera.wavelengths": values}, quantities=["mtf50"], engine="serial")
    rows = list(swept.rows())
    assert list(dict.fromkeys(row["camera.wavelengths"] for row in rows)) == shown
    assert [row["wavelength_nm"] for row in rows] == lines
    for row in rows:
        assert row["value"] == pytest.approx(float(CAMERA.mtf(PANEL, row["wavelength_nm"]).frequency_at(0.5)))
    assert swept.sensitivities == ()


def test_a_sweep_takes_arrays_of_lengths_as_micrometres() -> None:
    over = {"camera.pixel": np.array([1, 2]), "camera.focal": {"uniform": [5000, np.float64(6000)]}}
    swept = mf.sweep(PANEL, SINGLE, over=over, cases=2, quantities=["open_ratio"], engine="serial")
    assert {row["camera.pixel"] for row in swept.rows()} == {"1 um", "2 um"}


@pytest.mark.parametrize(
    ("over", "told"),
    [
        ({"camera.wavelengths": [{"line": 1}]}, r"MF105 .*is no value of a key .*over\['camera.wavelengths'\]"),
        ({"camera.wavelengths": [5]}, r"MF156 a wavelength of 5 nm .*over\['camera.wavelengths'\]"),
        ({"camera.pixel": []}, r"MF105 no value is stated .*over\['camera.pixel'\]"),
        ({"camera.wavelengths": [[["450 nm"]]]}, "MF105 .*is no value of a key"),
    ],
)
def test_what_no_sweep_takes_is_refused_in_plain_words(over: Any, told: str) -> None:
    with pytest.raises(InputError, match=told) as refusal:
        mf.sweep(PANEL, SINGLE, over=over)
    assert len(refusal.value.faults) == 1
    assert not {"tuple", ".bool", "boolean"} & set(str(refusal.value).replace("[", " ").split())


@pytest.mark.parametrize(
    ("key", "length", "told"),
    [
        ("min_feature", "24 um", "Write min_feature_dots = 3: it counts dots, here of 8 um"),
        ("min_feature_dots", "24 um", "Write min_feature_dots = 3: it counts dots, here of 8 um"),
        ("min_feature_dots", "12 um", "Write min_feature_dots = 1 or 2: it counts dots, and 12 um are 1.5 of 8 um"),
    ],
)
def test_a_length_for_a_number_of_dots_is_told_in_dots(key: str, length: str, told: str) -> None:
    with pytest.raises(JobError) as refusal:
        mf.design(dots=21, pitch="168 um", clear_dots=100, rules={key: length}, budget="3 s")
    assert refusal.value.cure == told
    with pytest.raises(JobError, match="Write min_feature_dots as a whole number"):
        mf.design(dots=21, clear_dots=100, rules={key: length}, budget="3 s")


def test_printed_numbers_say_their_level_and_their_file() -> None:
    rows = [Quantity("restored_psnr", level, "mean", die="A", level_db=level) for level in (24.0, 32.0)]
    rows += [Quantity("judged_die", 0, f"{name}: corners", 0, True, die="A") for name in ("P.gds", "P_R12.dxf")]
    rows += [Quantity("readback_xor_area", 0.0, "P.gds, read", 0.0, True, die="A")]
    lines = str(Quantities(rows)).splitlines()[1:6]
    for line, place in zip(lines, ("24 dB", "32 dB", "P.gds", "P_R12.dxf", ""), strict=True):
        assert place in line
    assert "P.gds" not in lines[4]
    assert "P_R12.dxf" in Quantities(rows)._repr_html_()
