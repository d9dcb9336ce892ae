"""One job with other values of some keys: cases, their numbers, and what the numbers depend on."""
