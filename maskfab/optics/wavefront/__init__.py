"""Phase and parallax: defocus, aberrations, and a panel at some distance from the stop."""
