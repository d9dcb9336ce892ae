"""Mask houses: their rules, what a plate must become for them, and the order that goes along."""
