"""Figures as SVG or PNG, equal drawings with equal bytes."""
