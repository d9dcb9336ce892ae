"""Restorers: what undoes the blur of a record. How a record is made is not here, nor how its restoration is scored."""
