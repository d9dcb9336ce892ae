"""Words, tables and figures of what was found: documents and figures that hold numbers, and pages that people read.

``text`` words a number and ``verdicts`` a plate; ``documents`` are the JSON that programs read, with their schemas;
``figures`` draw; ``pages`` are made from documents and figures alone. Numbers are found in :mod:`maskfab.findings`, and
what each means is in :mod:`maskfab.base.quantities`. Every room below is imported; runs, which decide what is computed,
and the door are not.
"""
