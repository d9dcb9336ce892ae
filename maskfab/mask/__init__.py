"""Masks: openings, panels and plates, the files that show them, and what mask houses say of both.

Here are the clear shape of a pixel and how cells are tiled (:mod:`opening`, :mod:`panels`), the plate round them
(:mod:`plate`, :mod:`marks`), its polygons (:mod:`layout`, :mod:`figures`) and rasters (:mod:`dots`, :mod:`raster`), the
rules of drawing (:mod:`rule`, :mod:`panel_rules`, :mod:`plate_rules`) and a writer's bias and corners (:mod:`writer`).
Folders hold one file for each format, the comparison of files with the plate, mask houses, their packages, and the
judge, who shares no code with any of them. What light makes of a mask is in :mod:`maskfab.optics`, displays round the
openings in :mod:`maskfab.display`. Imports base, job and optics."""
