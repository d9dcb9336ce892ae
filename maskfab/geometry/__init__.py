"""Masks as polygons and rasters, exact to the nanometre.

Files are read in :mod:`maskfab.readers`, rules checked in :mod:`maskfab.drc`.
"""
