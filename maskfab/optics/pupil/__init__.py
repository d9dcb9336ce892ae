"""The part of the panel that the lens sees: apertures, stops of any shape, wires."""
