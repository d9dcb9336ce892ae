"""How far the scene that a job describes is from the one that its report models."""

from __future__ import annotations

from maskfab.model import Camera, Die, Quantity
from maskfab.optics.aperture import panel_aperture
from maskfab.optics.omissions import Scene, estimate
from maskfab.optics.pupil import cut
from maskfab.spec import SceneSection


def scene_left_out(die: Die, camera: Camera, section: SceneSection) -> Quantity:
    """The estimated error of a report's PSF for the scene, judged by the accuracy that the scene asks for.

    A report models objects in focus at infinity, on the axis, with the panel in the plane of the stop, a perfect lens
    and the camera's own lines; ``maskfab plan`` tells which of these the scene needs otherwise.
    """
    scene = Scene.of(section)
    pupil = cut(panel_aperture(die.panel, camera.stop.diameter_um / 2), camera.stop)
    found = estimate(die.panel, pupil, camera, scene, section.accuracy)
    parts = {
        "near focus": found.scale.error,
        "defocus": found.defocus.error,
        "aberrations": found.aberrations.error,
        "shift through the gap": found.shift.error,
        "diffraction over the gap": found.diffraction.error,
        "width of the bands": found.bands[min(found.bands)] if found.in_bands else 0.0,
    }
    total = sum(parts.values())
    told = ", ".join(f"{name} {error:.1e}" for name, error in parts.items() if error > 0) or "nothing"
    return Quantity(
        "scene_left_out",
        "Σε",
        total,
        "1",
        f"estimated relative L2 error of the PSF by what the report leaves out of the scene: {told}",
        limit=section.accuracy,
        passed=total <= section.accuracy,
        die=die.name,
    )
