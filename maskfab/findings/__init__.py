"""Optical and geometric numbers of a die, from the polygons that were read back: PSFs, MTFs, bands and scores.

Which of them there are, and what each depends on and costs, stands in :mod:`maskfab.base.findings`; whether files are
the design's is told in :mod:`maskfab.mask`. Documents, figures and pages are made of them in :mod:`maskfab.report`.
"""
