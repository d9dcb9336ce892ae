"""Pictures and fields as files: bitmaps of masks, emitted light as OpenEXR and PNG, PSFs as OpenEXR.

Writers of three-dimensional files: STEP and meshes.

DXF entities, grids and texts that the library's reader passes over in silence.
"""
