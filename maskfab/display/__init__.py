"""The emissive side of a pixel: room for emitters and wires beside the opening, and the light it gives.

The camera's side is in :mod:`maskfab.optics`.
"""
