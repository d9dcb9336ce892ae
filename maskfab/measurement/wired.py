"""Effect of a display's wires on the picture: the light that they leave, and the change of the PSF."""

from __future__ import annotations

from dataclasses import replace

from maskfab.model import ORIENTATIONS, Camera, Die, Quantity
from maskfab.optics.image.psf import point_psf
from maskfab.optics.numbers.metrics import relative_difference
from maskfab.optics.pupil.aperture import panel_aperture
from maskfab.optics.pupil.pupil import cut
from maskfab.optics.pupil.wire_transmission import veil


def wired_quantities(die: Die, camera: Camera) -> tuple[Quantity, ...]:
    """Transmission and change of the PSF by the wires over the openings; nothing where no wire covers any.

    The mask has no wires: all else that is told of the die is without them.
    """
    panel = die.panel
    if not any(track.transmission < 1 for track in panel.tracks):
        return ()
    patterns = panel.patterns
    _, power = veil(panel)
    cells = panel.orientations.ravel()
    passed = (patterns * power[[k % ORIENTATIONS for k in range(len(patterns))]]).sum(axis=(1, 2))[cells].sum()
    share = float(passed / patterns.sum(axis=(1, 2))[cells].sum())
    if share > 1 - 1e-12:
        return ()
    wavelength = camera.wavelengths_nm[len(camera.wavelengths_nm) // 2]
    bare, wired = (
        point_psf(cut(panel_aperture(each, camera.stop.diameter_um / 2), camera.stop), camera, wavelength)
        for each in (replace(panel, tracks=()), panel)
    )
    return (
        Quantity(
            "wired_transmission",
            share,
            "light that the wires leave over the light through the openings, exact from their outlines",
            die=die.name,
        ),
        Quantity(
            "wired_psf_change",
            relative_difference(wired, bare),
            "relative L2 of the point PSF with the wires against that without, each over the light it holds: mean "
            "amplitude and mean power of every dot",
            wavelength_nm=wavelength,
            die=die.name,
        ),
    )
