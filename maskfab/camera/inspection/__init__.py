"""Inspection of a die through a camera: what frames of a point light, or of slanted edges, tell of it and of its MTF.

Frames come from :mod:`maskfab.camera.frames`; the verb ``measure`` asks both and writes the answer.
"""
