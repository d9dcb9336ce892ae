"""Room for drive circuits, against areas that can be counted."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.base.errors import JobError
from maskfab.base.model import Emitters, Opening
from maskfab.display.drive import CircuitRules, emitter_rooms, pixel_room
from maskfab.display.emitter_rules import Proof


def test_room_at_two_pitches() -> None:
    mask = np.zeros((21, 21), dtype=bool)
    mask[:10, :10] = True
    wide, narrow = (pixel_room(Opening("x", mask, 8000), dot, CircuitRules(min_width_nm=dot)) for dot in (8000, 4030))
    assert wide.certificate is None
    assert wide.area_um2 == wide.closed_um2 == 341 * 64
    assert narrow.certificate is not None
    assert narrow.certificate.proof is Proof.CIRCUIT_AREA
    assert pixel_room(Opening("x", mask, 4030), 4030, CircuitRules(min_width_nm=4030, shared_by=2)).certificate is None


@pytest.mark.parametrize("width", [1, 2, 3])
def test_corridors_count_only_if_wide_enough(width: int) -> None:
    mask = np.ones((12, 12), dtype=bool)
    mask[:, 4 : 4 + width] = False
    room = pixel_room(Opening("x", mask, 1000), 1000, CircuitRules(min_width_nm=2000))
    assert room.area_um2 == (12 * width if width > 1 else 0)


def test_each_emitter_has_its_own_room() -> None:
    labels = np.zeros((12, 12), dtype=np.int8)
    labels[:, :4], labels[:, 4:8], labels[:6, 8:] = 1, 2, 3
    rooms = emitter_rooms(Emitters(labels, 8000), CircuitRules())
    assert [room.certificate is None for room in rooms] == [True, True, False]


def test_bad_rules() -> None:
    with pytest.raises(JobError, match="MF118"):
        pixel_room(Opening("x", np.ones((21, 21), dtype=bool), 8000), 8000, CircuitRules(min_width_nm=8001))
