"""Small panels and cameras that the optics tests share with the hard cases."""

from __future__ import annotations

from maskfab.benchmark.examples import camera, clear_region, noise, panel, pupil

__all__ = ["camera", "clear_region", "noise", "panel", "pupil"]
