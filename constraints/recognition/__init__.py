"""Which constraint two surfaces in contact could mean: the table of pairings, candidates, fits, evidence of threads.

May use `geometry`, `kinds`, `solve` and the contacts of `collision`.
Start with `pairings` (the one table, a row for each pair of surface types), then `recognise`, which applies it to
contacts; `iso286` and `thread_evidence` decide whether an overlap is a fit.
"""
