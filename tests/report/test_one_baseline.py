"""The gain of a map is told over the panel whose PSNR stands beside it, and the numbers add up as they are told."""

from __future__ import annotations

import re
from typing import Any

import pytest
from once import leaves

import maskfab as mf
from maskfab.camera import scenes
from maskfab.report.pages.design import design_page
from maskfab.report.text import designed_lines

JOB = """
[design]
name = "small"
dots = 8
pitch = "168 um"
clear_dots = 12
families = ["bars"]
map = "equal_light"
map_output = "small_map.toml"

[camera]
focal = "10 mm"
stop = { shape = "circle", diameter = "1.6 mm" }
wavelengths = ["610 nm", "530 nm", "470 nm"]
pixel = "2 um"
"""


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Any:
    place = tmp_path_factory.mktemp("mapped")
    (place / "job.toml").write_text(JOB)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scenes, "bundled", lambda count=4: (leaves(1),))
        return mf.design(place / "job.toml")


def test_the_document_adds_up(mapped: Any) -> None:
    cells = mapped.to_dict()["map"]
    for level, gain in cells["gain_db"].items():
        assert gain == pytest.approx(cells["expected_psnr_db"][level] - cells["random_psnr_db"][level], abs=1e-12)


def test_the_page_adds_up(mapped: Any) -> None:
    page = design_page(mapped.to_dict())
    table = page[page.index('<section id="psnr">') :]
    random, own, gain = (
        [float(value) for value in re.findall(r'<td class="n">([-+.\d]+)</td>', row)]
        for row in re.findall(r"<tr><th scope=.*?</tr>", table)[:3]
    )
    assert [round(a + b, 2) for a, b in zip(random, gain, strict=True)] == own


def test_the_terminal_adds_up(mapped: Any) -> None:
    lines = designed_lines(mapped.found, [])
    with_it = re.findall(r"([\d.]+) dB at", lines[0])
    (line,) = (line for line in lines if line.startswith("gain of the designed map over a random one"))
    gains, starts = (re.findall(r"([\d.]+) dB at", part) for part in line.split(", from "))
    assert [round(float(a) + float(b), 2) for a, b in zip(starts, gains, strict=True)] == [float(a) for a in with_it]
