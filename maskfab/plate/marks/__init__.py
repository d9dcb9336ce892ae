"""Everything on a plate but its dies: titles, fiducials, test patterns, and templates that place them."""
