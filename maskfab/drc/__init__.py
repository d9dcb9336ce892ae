"""Design rules of a plate or of any layout, checked exactly."""
