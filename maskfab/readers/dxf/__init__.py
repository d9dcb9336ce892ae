"""DXF entities, grids and texts that the library's reader passes over in silence."""
