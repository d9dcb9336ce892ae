from __future__ import annotations

import base64
import io
import re
from dataclasses import replace
from html import unescape
from itertools import pairwise
from urllib.parse import unquote
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.image import imread

from maskfab.base.model import Psf
from maskfab.base.processes import ProcessExecutor
from maskfab.report.documents.report import to_document
from maskfab.report.figures import die, report
from maskfab.report.figures.sheet import styled

MARKUP = "<script>alert('x')</script>"


@pytest.fixture(scope="module")
def drawn(run):
    return report.pictures(run.plate, run.optics, to_document(run.report, run.plate, run.camera))


def svg(image: str) -> str:
    return unquote(unescape(re.search("src='data:image/svg[+]xml,([^']*)'", image)[1]))


def embedded(image: str) -> list[np.ndarray]:
    found = re.findall("data:image/png;base64,([A-Za-z0-9+/=]+)", svg(image))
    return [imread(io.BytesIO(base64.b64decode(data)), format="png") for data in found]


def test_every_die_and_the_plate_have_their_pictures(run, drawn):
    assert set(drawn) == {die.PLATE, "PLAIN", "TURNED"}
    assert set(drawn[die.PLATE]) == {"drawing", "places", "mtf"}
    assert set(drawn["PLAIN"]) == {
        "opening", "panel", "psf", "mtf", "mtf_small", "panel_small", "psf_small", "psf_own_peak",
    }  # fmt: skip


def test_a_dim_psf_is_dim_on_the_common_scale_and_whole_by_its_own_peak(run):
    psf = run.optics[0].psfs[0]
    bright = die.psf_thumbnail(psf, 1000 * float(psf.values.max()))
    own = die.psf_thumbnail(psf)
    level = {name: picture(image)[..., :3].sum(axis=2).max() for name, image in (("bright", bright), ("own", own))}
    assert level["bright"] < 0.7 * level["own"]
    assert die.psf_thumbnail(replace(psf, values=psf.values * 1e-3)) == own


def picture(image: str) -> np.ndarray:
    (data,) = re.findall("data:image/png;base64,([A-Za-z0-9+/=]+)", image)
    return imread(io.BytesIO(base64.b64decode(data)), format="png")


def test_dies_are_told_apart_in_grey_by_names_marks_and_thickness(run):
    dies = [replace(item, die=replace(item.die, name=f"{item.die.name}{k}")) for k in range(6) for item in run.optics]
    names = [item.die.name for item in dies]
    sheet = die.mtf_comparison(dies, names[3:4]).figure
    curves = {line.get_label(): line for line in sheet.axes[0].get_lines() if line.get_label() in names}
    assert len({curve.get_marker() for curve in curves.values()}) == len(dies)
    assert [name for name in names if curves[name].get_linewidth() > 2] == names[3:4]
    heights = sorted(text.get_position()[1] for text in sheet.axes[0].texts if text.get_text() in names)
    assert len(heights) == len(dies)
    assert min(np.diff(heights)) > 0.04


@given(st.lists(st.floats(0, 1), min_size=1, max_size=15).map(sorted))
def test_names_beside_curves_stay_apart_and_in_order_and_where_they_were_if_there_is_room(wanted):
    found = die.spread(wanted, 0.05, 0.0, 1.0)
    assert min(found) >= -1e-9
    assert max(found) <= 1
    assert all(later - sooner >= 0.05 - 1e-9 for sooner, later in pairwise(found))
    if all(later - sooner >= 0.05 for sooner, later in pairwise(wanted)):
        assert found == pytest.approx(wanted)


def test_which_process_draws_does_not_show(run, drawn):
    document = to_document(run.report, run.plate, run.camera)
    more = [report.Figures(item.die.name, dict, ({"more": item.die.label},)) for item in run.optics]
    with ProcessExecutor() as executor:
        shared = report.pictures(run.plate, run.optics, document, more, executor)
    told = {name: images.pop("more", None) for name, images in shared.items()}
    assert shared == drawn
    assert told == {die.PLATE: None} | {item.die.name: item.die.label for item in run.optics}


def test_pictures_are_images_with_words_and_ask_for_nothing_outside(drawn):
    for image in (image for images in drawn.values() for name, image in images.items() if name != "places"):
        assert re.fullmatch(r"""<img class="\w+" src='data:image/[^'<>]*' alt="[^"<>]+">""", image)
        if "svg+xml" in image:
            root = ElementTree.fromstring(svg(image))
            links = [value for node in root.iter() for key, value in node.attrib.items() if key.endswith("href")]
            assert all(link.startswith(("#", "data:image/png")) for link in links)


def test_equal_input_gives_equal_bytes(run, drawn):
    assert report.pictures(run.plate, run.optics, to_document(run.report, run.plate, run.camera)) == drawn


def test_figures_leave_the_settings_of_matplotlib_alone(run):
    before = dict(mpl.rcParams)
    die.mtf(run.optics[0].mtfs)
    assert dict(mpl.rcParams) == before


def test_figures_do_not_depend_on_the_readers_settings_of_grid_and_font_size(run, drawn):
    with mpl.rc_context({"font.size": 30.0, "svg.hashsalt": "other"}):
        assert die.psf(run.optics[0].psfs).img() == drawn["PLAIN"]["psf"]


def test_titles_sit_where_measuring_every_label_would_put_them(run, drawn, monkeypatch):
    monkeypatch.setitem(styled.args[0], "axes.titley", None)
    for figure, items in ((die.psf, run.optics[0].psfs), (die.mtf, run.optics[0].mtfs)):
        texts = re.compile(r"%3Ctext.*?%3C/text")
        assert texts.findall(figure(items).img()) == texts.findall(drawn["PLAIN"][figure.__name__]) != []


def test_all_psfs_have_one_colour_scale():
    """A sample a hundred times below its PSF's peak has one colour, whatever the peak."""
    base = np.zeros((5, 5))
    base[2, 2], base[2, 4] = 1.0, 0.01
    faint, strong = (die.psf((Psf(base * scale, 1.0, 530.0, "point"),)).img() for scale in (1e-7, 3.0))
    assert faint == strong
    bar = embedded(strong)[1]
    assert bar.shape[0] == 256
    colours = [
        embedded(die.psf((Psf(values, 1.0, 530.0, "point"),)).img())[0][2, 4] for values in (base, base.clip(1e-3))
    ]
    np.testing.assert_array_equal(colours[0], colours[1])
    position = np.abs(bar[:, 0] - colours[0]).sum(axis=1).argmin()
    assert position == pytest.approx(256 * 4 / 6, abs=2)  # two of six decades below the top


def test_of_two_samplings_of_a_wavelength_the_finer_is_drawn(run):
    fine = run.optics[0].psfs
    coarse = tuple(Psf(psf.values[::4, ::4], 8.0, psf.wavelength_nm, "pixel") for psf in fine)
    mixed = [item for pair in zip(coarse, fine, strict=True) for item in pair]
    assert die.psf(mixed).img() == die.psf(fine).img()


def test_plate_drawing_says_where_things_are(drawn):
    words = "".join(ElementTree.fromstring(svg(drawn[die.PLATE]["drawing"])).itertext())
    for word in (
        "PLAIN",
        "TURNED",
        "FAIL",
        "blank 127 mm",
        "writable 117 mm",
        "slot 12 mm",
        "step 20 mm",
        "(0.5, 0.5)",
    ):
        assert word in words


def test_markup_in_a_title_stays_text(run, drawn):
    assert all("<script" not in image for images in drawn.values() for image in images.values())
    assert MARKUP in run.plate.title


def test_overview_is_one_png_with_equal_bytes(run):
    document = to_document(run.report, run.plate, run.camera)
    image = die.overview(run.plate, document, run.optics[1])
    assert image.startswith(b"\x89PNG")
    assert image == die.overview(run.plate, document, run.optics[1])


def test_optics_of_one_opening_are_one_png_with_equal_bytes(run):
    item = run.optics[0]
    image = die.optics(item.psfs, item.mtfs, "block $")
    assert image.startswith(b"\x89PNG")
    assert image == die.optics(item.psfs, item.mtfs, "block $")


@pytest.mark.parametrize("lines", [1, 2, 3])
def test_the_legend_of_the_mtf_lies_on_the_sheet_and_covers_nothing(run, lines):
    sheet = die.mtf((run.optics[0].mtfs * 2)[:lines]).figure
    renderer = FigureCanvasAgg(sheet).get_renderer()
    legend = sheet.legends[0].get_window_extent(renderer)
    assert legend.x0 >= 0
    assert legend.y0 >= 0
    assert legend.x1 <= sheet.bbox.x1
    assert all(not legend.overlaps(axes.get_tightbbox(renderer)) for axes in sheet.axes)
