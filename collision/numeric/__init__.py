"""Numbers that the rest is built on: vectors, poses, exact predicates, eight lanes at once."""
