"""References for our answers: the published algorithm with its counts, brute force, and coal.

`oaabb` is the algorithm of the paper; `oracle` has coal behind the interface of this package, and `shape` the objects
that are no meshes, which coal answers for.
May use all of `collision`; coal is loaded at first use.
Start with `oracle`.
"""
