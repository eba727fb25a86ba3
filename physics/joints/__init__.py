"""Accepted constraints as joints between bodies: velocity rows, friction, articulated motion.

May use `model`, and `constraints` for kinds, freedom and lower pairs.
Start with `rows`; `articulated_body` and `articulated_motion` integrate an island of joints in joint coordinates,
`thread` and `screw_friction` are the friction of screws.
"""
