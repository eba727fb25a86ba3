"""A session: its state, its step, its events and observers.

May use `hands`, `analysis`, `scene` and the three packages below; viewers, recorders and reports observe it and are
called by `services`, never imported.
Start with `session` (what scripts call) and `step` (the stages), then `state` (all that changes, as one value) and
`engine` (the managers that it is read from).
"""
