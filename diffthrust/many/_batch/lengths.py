"""To which lengths logs are padded, that few programs are compiled and little is computed in vain.

Programs are compiled for a length. Of logs of many lengths each could have its own, which costs
compilations, or all could be made as long as the longest, which costs steps of no use. Between the
two lies the cheapest set of lengths, which dynamic programming finds.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

PROGRAM = 4_000_000
"""What the programs for one more length cost, in samples of logs that could be fitted meanwhile."""
_MOST = 512  # lengths that are told apart


def ladder(lengths: Iterable[int], program: float = PROGRAM) -> list[int]:
    """The lengths to pad to, ascending: each log goes to the next that it fits in.

    Args:
        lengths: of the logs, in samples.
        program: what one more length costs, in samples.

    Returns:
        The set of the least total cost; of very many lengths, neighbours are taken as equal first.

    Example:
        >>> ladder([1000] * 50 + [1010] * 50, program=20_000)
        [1010]
    """
    sizes, counts = np.unique(np.asarray(list(lengths), int), return_counts=True)
    if sizes.size > _MOST:
        edges = np.unique(np.linspace(0, sizes.size - 1, _MOST).astype(int))
        place = np.searchsorted(edges, np.arange(sizes.size))
        sizes, counts = sizes[edges], np.bincount(place, weights=counts)
    below = np.concatenate([[0.0], np.cumsum(counts)])
    # best[i]: the least cost of the i shortest; the longest of them is a length of the set
    best, cut = np.zeros(sizes.size + 1), np.zeros(sizes.size + 1, int)
    for i in range(1, sizes.size + 1):
        costs = best[:i] + program + sizes[i - 1] * (below[i] - below[:i])
        cut[i] = int(np.argmin(costs))
        best[i] = costs[cut[i]]
    out, i = [], sizes.size
    while i > 0:
        out.append(int(sizes[i - 1]))
        i = int(cut[i])
    return out[::-1]
