"""Captures of a camera: read, merged, and held against what was designed."""
