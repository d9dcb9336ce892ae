import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maskfab.base.cell_size import CellSize
from maskfab.base.errors import JobError
from maskfab.base.model import Opening, Panel, Tiling

CELLS = st.builds(
    CellSize, st.integers(1, 200), st.integers(1, 50_000), st.integers(0, 20_000).map(lambda half_nm: 2 * half_nm)
)


@given(CELLS)
def test_a_cell_is_found_again_from_its_pitch_by_its_dots_and_by_the_size_of_a_dot(cell: CellSize) -> None:
    assert CellSize.of_pitch(cell.pitch_um, cell.dots, cell.gutter_nm, where="here") == cell
    assert CellSize.filling(cell.pitch_um, cell.dot_nm, cell.gutter_nm) == cell


@given(CELLS)
def test_the_edges_of_a_cell_add_up_to_its_pitch_and_lie_symmetrically(cell: CellSize) -> None:
    widths = np.diff(cell.edges_nm)
    assert widths.sum() == cell.pitch_nm
    assert sorted(widths) == sorted([cell.dot_nm] * cell.dots + [cell.gutter_nm // 2] * 2 * (cell.gutter_nm > 0))
    np.testing.assert_array_equal(cell.pitch_nm - cell.edges_nm[::-1], cell.edges_nm)
    assert np.ptp(cell.dot_edges_nm) == cell.dots_nm


def test_an_inch_holds_as_many_cells_as_the_density_says() -> None:
    assert CellSize(21, 8000, 1_332_000).dpi * 1500 == 25_400


@given(CELLS, st.integers(1, 1_000_000))
def test_another_pitch_is_refused_with_the_dot_that_would_make_it(cell: CellSize, dot_nm: int) -> None:
    cell.require_pitch(cell.pitch_um, where="die")
    stated = CellSize(cell.dots, dot_nm, cell.gutter_nm).pitch_um
    if dot_nm == cell.dot_nm:
        return
    with pytest.raises(JobError, match="MF106") as refused:
        cell.require_pitch(stated, where="die")
    assert f'dot = "{dot_nm / 1000:g} um"' in str(refused.value.cure)


def test_a_pitch_that_no_whole_dot_makes_is_refused_with_the_nearest() -> None:
    with pytest.raises(JobError, match="MF107") as refused:
        CellSize(7, 8000).require_pitch(25_400 / 300, where="die")
    assert "84.665 um" in str(refused.value)


def test_a_panel_takes_its_pitch_from_its_cell() -> None:
    opening = Opening("unit", np.eye(3, dtype=bool), 8000)
    panel = Panel(opening, 5000, 4000, np.zeros((2, 5), np.int8), Tiling.PERIODIC, None)
    assert panel.cell_size == CellSize(3, 5000, 4000)
    assert panel.size_nm == (5 * 19_000, 2 * 19_000)
    assert opening.cell_size.pitch_nm == 24_000
