"""A die as drawn, read back and written, side by side."""

from __future__ import annotations

from report.test_report_html import row

from maskfab.report.pages.tables import stage_table


def die(*rows: dict) -> dict:
    return {"quantities": list(rows)}


READ = (row("stop_open_ratio", 0.2), row("auc_radial_min", 0.3, 610.0), row("auc_radial_min", 0.1, 530.0))
WRITTEN = (
    row("written_psf_difference_fused", 0.02, 530.0),
    row("written_open_ratio_fused", 0.21),
    row("written_auc_radial_min_fused", 0.12, 530.0),
    row("written_auc_radial_min_fused", 0.32, 610.0),
)


def cells(table) -> dict[str, tuple]:
    return {line.name.split()[0]: line.cells for line in table.lines}


def test_stages_stand_side_by_side_at_one_wavelength():
    exact = (row("readback_xor_area", 0.0), row("readback_xor_area", 0.0), row("readback_psf_difference", 1e-9, 530.0))
    table = stage_table(die(*exact, *READ, *WRITTEN), 530.0)
    assert table.columns == ("Drawn", "Read back", "As written, touching dots fused")
    told = cells(table)
    assert told["PSF"] == (0.0, 1e-9, 0.02)
    assert told["Open"] == (0.2, 0.2, 0.21)
    assert told["MTF50"] == (None, None, None)
    assert table.lines[3].cells == (0.1, 0.1, 0.12)


def test_a_file_that_differs_says_nothing_of_the_drawing():
    table = stage_table(die(row("readback_xor_area", 0.0), row("readback_xor_area", 2.5), *READ), 530.0)
    assert table.columns == ("Drawn", "Read back")
    assert cells(table)["Open"] == (None, 0.2)
    assert table.lines[0].cells == (0.0, 2.5)


def test_what_was_not_read_back_has_no_stages():
    assert stage_table(die(*READ), 530.0) is None
