"""Panels of tiled cells and the plate that holds them. Polygons are drawn in :mod:`maskfab.geometry`."""
