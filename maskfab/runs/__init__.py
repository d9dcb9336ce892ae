"""Work on a whole job: made into a plate, checked again, foreseen, and swept.

Where every number comes from stands in :mod:`maskfab.base.findings`; the chain reads on one page in
:mod:`maskfab.runs.pipeline`, its files in :mod:`maskfab.runs.plate_files`, its dies in :mod:`maskfab.runs.stages`, what
comes of it in :mod:`maskfab.runs.result`. Earlier findings are kept by :mod:`maskfab.runs.store`. Nothing is computed
or drawn here: that is of the rooms below, all of which this one may import; only the door imports it.
"""
