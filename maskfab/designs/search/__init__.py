"""Search over discrete openings: scan, anneal, choose, and finish with a map."""
