"""Contact: points between near surfaces, the set of contacts at one instant, and their problem of forces and impacts.

May use `model`, `joints`, `solver`, and the queries of `collision`.
Start with `contact_set` (what a step asks), then `contact_problem` (the rows for the solver); `narrow_phase` finds the
points, `neighbour_list` the pairs of surfaces that it looks at.
"""
