"""Diffraction by a panel before a lens. Everything here is physics on arrays; files and reports are elsewhere."""
