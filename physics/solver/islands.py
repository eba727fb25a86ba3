"""Connected components of bodies, by union-find over pairs."""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import kernel


@kernel(allocates=True)
def components(n, pairs):
    """Labels (n,) of the components of the graph with nodes 0 … n-1 and edges `pairs` (c, 2), and their number.

    Edges with a node -1 are skipped. Components are numbered by their least node.
    """
    root = np.arange(n)
    for c in range(pairs.shape[0]):
        i, j = pairs[c, 0], pairs[c, 1]
        if i < 0 or j < 0:
            continue
        while root[i] != i:
            root[i] = root[root[i]]
            i = root[i]
        while root[j] != j:
            root[j] = root[root[j]]
            j = root[j]
        root[max(i, j)] = min(i, j)
    count = 0
    label = np.empty(n, np.int64)
    for i in range(n):  # a root is the least of its group, so it has its label before the others ask for it
        j = i
        while root[j] != j:
            j = root[j]
        if j == i:
            label[i] = count
            count += 1
        else:
            label[i] = label[j]
    return label, count
