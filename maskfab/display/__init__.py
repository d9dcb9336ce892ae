"""The emissive side of a pixel: emitters, circuits and wires beside the opening, the light they give, and the eye.

Placement and wiring come with proofs where they cannot be, in every orientation. The room imports mask, optics, job and
base; photographs through the display are in :mod:`maskfab.camera`, searches for openings that it fits in
:mod:`maskfab.designs`.
"""
