"""Numbers of a plate, the documents and figures that hold them, and the pages that people read.

``rows`` measures, from the polygons that were read back; ``documents`` are the JSON that programs read, with their
schemas; ``figures`` draw; ``pages`` are made from documents and figures alone. What a number means is in
:mod:`maskfab.base.quantities`, and whether files are the design's is told in :mod:`maskfab.mask`. Every room below is
imported; runs, which decide what is computed, and the door are not.
"""
