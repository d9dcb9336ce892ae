"""A camera behind the panel: photographs simulated, restored and scored, and real ones read, restored and inspected.

The simulated chain is ``scenes``, ``imaging`` (by ``stop_cells``, ``die_transfer`` or ``field_transfer``), ``sensor``,
``record``, the folder ``restorers`` and ``scores``; ``protocol`` runs it. Real frames are in the folder ``frames``,
what they tell of a die in ``inspection``. How a display looks to people is in :mod:`maskfab.display`. Rooms above are
not imported: designs, reports, runs and the door.
"""
