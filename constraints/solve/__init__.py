"""The equations of constraints as one system, and its solution by Levenberg-Marquardt.

May use `kinds` for their equations, `geometry`, and `collision.numeric` for kernels.
Start with `solver` (the entry), then `system` (flat arrays and order of elimination) and `jacobians` (the derivatives);
`block_cholesky` and `ranks` are the linear algebra.
"""
