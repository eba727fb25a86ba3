"""Answers to hold ours against: the published algorithm with its counts, brute force, and coal."""
