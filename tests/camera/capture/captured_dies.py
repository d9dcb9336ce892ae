"""Pictures of a point light through a die by another way than the fit's: polygons as they are written, turned, at many
lines, or a phase on exact dots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from klayout import db
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.base.model import Panel, Psf
from maskfab.camera.frames.frame import Frame
from maskfab.findings.optics import polygon_psf, stop_boundary
from maskfab.job.camera import Camera
from maskfab.job.process import Process
from maskfab.mask.writer import Reading, written_region
from maskfab.optics.phase import Wavefront, phased, phased_psf, window_frequency
from maskfab.optics.psf import odd_samples, pixel_margin, pixel_psf, point_step_um
from maskfab.optics.pupil import cut, panel_aperture
from maskfab.optics.stop_edges import edges_in_stop

Floats = NDArray[np.float64]
READ_NOISE, GAIN, BLACK, WHITE = 4.87, 1.3, 512.0, 65535.0


def polygon_picture(
    panel: Panel, camera: Camera, lines: dict[float, float], *, bias_um: float, turn_rad: float
) -> Floats:
    """Share of the light in every pixel, row 0 the top, of polygons that grew by a bias and are turned."""
    # The shortest line sees the highest frequencies.
    camera = replace(camera, wavelengths_nm=(min(lines),))
    openings = panel_aperture(panel, camera.stop.diameter_um / 2)
    x, y = (np.rint(1000 * axis.edges_um()).astype(int) for axis in (openings.x, openings.y))
    drawn = db.Region()
    for row, column in np.argwhere(openings.transmission > 0.5):
        drawn.insert(db.Box(int(x[column]), int(y[row]), int(x[column + 1]), int(y[row + 1])))
    # The stop stays where it is: what it cuts is turned with the die, which a round one does not show.
    written = written_region(drawn, Process(0.0, bias_um), Reading.OPEN)
    edges, area = edges_in_stop(written, camera.stop, (0.0, 0.0))
    turn = np.array([[np.cos(turn_rad), np.sin(turn_rad)], [-np.sin(turn_rad), np.cos(turn_rad)]])
    edges = (edges.reshape(-1, 2, 2) @ turn).reshape(-1, 4)
    margin = pixel_margin(camera)
    outline = stop_boundary(edges, area, camera, margin)
    count = odd_samples(camera.window_um, point_step_um(camera)) + 2 * margin
    total = 0.0
    for line, weight in lines.items():
        like = Psf(np.zeros((count, count)), point_step_um(camera), line, "point")
        total = total + weight * pixel_psf(polygon_psf(outline, camera, like), camera).values
    return total[::-1] * camera.pixel_um**2


def phased_picture(
    panel: Panel, camera: Camera, terms: tuple[tuple[int, float], ...], source_um: float = 0.0
) -> Floats:
    """The same at the camera's only line behind a lens with errors, of a point or a Gaussian of such a deviation."""
    (line,) = camera.wavelengths_nm
    pupil = cut(panel_aperture(panel, camera.stop.diameter_um / 2), camera.stop)
    path = Wavefront(terms, line).waves(camera.stop, line)
    margin = pixel_margin(camera)
    wide = replace(camera, window_um=camera.window_um + 4 * margin * point_step_um(camera))
    points = phased_psf(phased(pupil, path, window_frequency(wide, line)), camera, line, margin=margin)
    if source_um:
        points = replace(points, values=ndimage.gaussian_filter(points.values, source_um / points.step_um))
    return pixel_psf(points, camera).values[::-1] * camera.pixel_um**2


def exposed(picture: Floats, times: tuple[float, ...], peak: float, seed: int) -> list[Frame]:
    """A stack of exposures whose first has so many electrons at its peak in time 1."""
    return exposed_each((picture,) * len(times), times, peak, seed)


def exposed_each(pictures: Sequence[Floats], times: tuple[float, ...], peak: float, seed: int) -> list[Frame]:
    """The same of a light that changes from exposure to exposure."""
    random = np.random.default_rng(seed)
    frames = []
    for picture, time in zip(pictures, times, strict=True):
        light = peak / pictures[0].max() * picture + 1.0
        electrons = random.poisson(light * time) + random.normal(0, READ_NOISE, picture.shape)
        counts = np.clip(np.rint(electrons / GAIN + BLACK), 0, WHITE).astype(np.float32)
        frames.append(Frame(f"{time:g}.tif", counts, (BLACK,), WHITE, None, 1e-3 * time))
    return frames
