"""Dies with shapes near the stop and none before it are told to be dark, whichever way their shapes are known."""

from __future__ import annotations

import numpy as np
import pytest
from klayout import db
from optics_cases import camera

from maskfab.base.model import CLEAR, Die, Plate
from maskfab.findings.foreign import optics_of_like
from maskfab.job.camera import Stop
from maskfab.job.process import UNSTATED
from maskfab.mask.layout import layer_info, plate_layout
from maskfab.mask.raster import axis_nm, light_box, sees_light

pytestmark = pytest.mark.usefixtures("read_here")

STOP = Stop("circle", 200.0)
SETTING = camera(STOP.diameter_um, window_um=32.0)


def corner_of_the_box(die: Die) -> db.Box:
    """A square that lies in the bounding box of the die's stop and not in its circle."""
    x, y = (round(c) for c in axis_nm(die))
    return db.Box(x + 80_000, y + 80_000, x + 99_000, y + 99_000)


def laid(shape: db.Box | db.Polygon) -> db.Layout:
    layout = db.Layout()
    layout.dbu = 0.001
    layout.create_cell("TOP").shapes(layout.layer(layer_info(CLEAR))).insert(shape)
    return layout


@pytest.mark.parametrize("slanted", [False, True], ids=["boxes", "polygons"])
def test_shapes_in_the_box_of_a_stop_and_not_in_its_circle_are_dark(small_plate: Plate, slanted: bool) -> None:
    die = small_plate.dies[0]
    box = corner_of_the_box(die)
    corners = [db.Point(box.left, box.bottom + 1000), db.Point(box.left, box.top), db.Point(box.right, box.top)]
    layout = laid(db.Polygon(corners) if slanted else box)
    (told,) = optics_of_like(die, SETTING, UNSTATED, plate_layout(small_plate), layout, equal=False)
    assert (told.name, told.value, told.passed, told.die) == ("optics", "dark", False, die.name)


def test_light_is_seen_where_any_of_it_lies_before_the_stop(small_plate: Plate) -> None:
    die = small_plate.dies[0]
    x0, y0, x1, y1 = light_box(die, STOP)
    x, y = (round(c) for c in axis_nm(die))
    beside = corner_of_the_box(die)
    for box, seen in (
        (db.Box(x - 10, y - 10, x + 10, y + 10), True),
        (db.Box(x0, y0, x1, y1), True),
        (db.Box(x + 70_000, y + 70_000, x + 90_000, y + 90_000), True),
        (beside, False),
        (db.Box(x + 100_001, y, x + 110_000, y + 10), False),
    ):
        boxes = np.array([[box.left, box.bottom, box.right, box.top]])
        assert sees_light(die, STOP, boxes) is seen
        assert sees_light(die, STOP, db.Region(box)) is seen
    assert not sees_light(die, STOP, np.zeros((0, 4), dtype=np.int64))
    assert not sees_light(die, STOP, db.Region())
