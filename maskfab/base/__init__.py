"""What every room stands on: vocabulary, units, errors, quantities, files written whole, processes."""

__version__ = "0.1.0"
