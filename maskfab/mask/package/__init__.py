"""One zip for a mask house: made, signed with hashes, and verified."""
