"""Photographs that were really taken: brought to linear light, restored, and developed."""
