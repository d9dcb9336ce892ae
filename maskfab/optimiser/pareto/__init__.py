"""Fronts of designs: what no other betters in photographs, emitters, wires and grain."""
