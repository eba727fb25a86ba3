"""What motion constraints leave: degrees of freedom, lower pairs, redundancy, conflicts, the assembly graph.

May use `solve` (ranks and null spaces), `kinds`, `geometry`.
Start with `mobility`, the function that sessions and tables call; `biconnected` cuts the assembly into blocks for it,
`lower_pairs` names the joints. `escape` is about contacts instead of constraints: which first motions they leave.
"""
