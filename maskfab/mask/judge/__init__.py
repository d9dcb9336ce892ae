"""The second opinion on a layout: what a plate has to show, derived from the job and the plate's template alone and
asked of the polygons that were read from a file. Imports base and job, and shares no code with what lays a plate out,
draws or writes it, so that a fault there is not made twice."""
