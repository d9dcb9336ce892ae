"""Written files against the plate that they were written from, and finished folders checked again."""
