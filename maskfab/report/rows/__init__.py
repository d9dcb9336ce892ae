"""Optical and geometric numbers of a die, from the polygons that were read back.

Whether they are the design's is told in :mod:`maskfab.mask`.
"""
