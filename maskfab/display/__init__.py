"""The emissive side of a pixel: room for emitters and wires beside the opening, and the light it gives.

The camera's side is in :mod:`maskfab.optics`.

Placement of red, green and blue emitters in the opaque area around an opening, for every orientation.

Wiring of the pixels: lines through the closed area, lines in the gutter, ports that fit in every orientation.

The eye: how a display looks whose pixels make room for a camera.
"""
