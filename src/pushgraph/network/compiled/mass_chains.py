"""Draw masses from what is known of them: evidence, a Gaussian over their logarithms, times what each may weigh.

Variables are the logarithms of masses (kg), and last that of the table's friction. Every variable is drawn given all
others, in turn; then bodies whose ratios the evidence ties move together along their common scale, first the two that
are tied most firmly, in the end all that are tied, whose scale motion leaves open (every force scales with mass).
Between two classes of mass there are gaps, which bodies that are tied can only cross together. What is known is not
always a ratio of two: so, too, one body of each cluster goes ahead, and the others follow as evidence has it. Then,
where forces were measured, all of them move against the friction.
"""

import math

import numpy as np

from pushgraph.network.compiled.jit import compiled

CELLS = 6
"""Each interval along a line is cut into so many."""
SPAN = 5.0
"""Farther than this many standard deviations from where evidence has its highest point, nothing is looked for."""
TIED = 0.05
"""Bodies, or clusters of them, that are correlated by this much in the evidence move together."""
MOST_INTERVALS = 64
RIDGE, LEAST_KNOWN = 1e-6, 1e-3
"""What is added to information before it is inverted: a share of it, and an amount."""
SMALLEST = 1e-9
"""Widens intervals by so much, so that rounding does not empty them."""


@compiled
def sweep(chains, information, pull, lowest, highest, density, free, uniforms, histogram):
    """Move all chains once, and say in the histogram what share of them weighs what.

    chains [chains variables]. information, pull: of the Gaussian, [variables variables] and [variables]. lowest,
    highest: bounds of the classes of each variable, logarithms, [variables classes], in rising order; density:
    logarithm of each class's share over its width. free: variables that are not known. uniforms [chains numbers], at
    least seven for each variable. histogram [masses bins]: equal parts of the classes, one class after the other; it
    has no rows where nobody asks for it.
    """
    count, variables = chains.shape
    masses = variables - 1
    histogram[:] = 0.0
    unused = histogram[:0]
    root, clusters, sizes = tied(information, masses, free)
    group_size = np.zeros(masses, np.int64)
    for i in range(masses):
        group_size[root[i]] += 1
    alone, everyone = np.empty(1, np.int64), np.empty(variables, np.int64)
    one, ahead = np.ones(1), np.ones(variables)
    follow = _followers(information, clusters, sizes)
    room = _room(lowest.shape[1])
    for chain in range(count):
        x, numbers, used = chains[chain], uniforms[chain], 0
        for i in range(variables):
            if free[i]:
                alone[0] = i
                answers = histogram if i < masses and group_size[root[i]] == 1 else unused
                _move(x, alone, one, information, pull, lowest, highest, density, numbers, used, answers, room)
                used += 2
        for k in range(len(sizes)):
            members = clusters[k, : sizes[k]]
            answers = histogram if group_size[root[members[0]]] == sizes[k] else unused
            _move(x, members, ahead, information, pull, lowest, highest, density, numbers, used, answers, room)
            leader = int(numbers[used + 2] * sizes[k])
            used += 3
            _move(
                *(x, members, follow[k, leader], information, pull, lowest, highest, density, numbers, used),
                *(unused, room),
            )
            used += 2
        friction = masses
        if free[friction] and information[friction, friction] > 0.0:
            size = 0
            for i in range(masses):
                if free[i] and information[i, friction] != 0.0:
                    everyone[size] = i
                    size += 1
            everyone[size] = friction
            ahead[size] = -1.0
            members = everyone[: size + 1]
            _move(x, members, ahead, information, pull, lowest, highest, density, numbers, used, unused, room)
            ahead[size] = 1.0
    histogram /= count


@compiled
def anneal(chains, information, pull, lowest, highest, density, free, uniforms, shares):
    """Make samples of the prior into samples of what is believed (sequential Monte Carlo, Del Moral et al. 2006).

    Evidence counts by shares that rise to 1. Each time chains are drawn from among themselves, as likely as what was
    added makes them, and moved. Chains that stand in the wrong classes give way before the gaps between them are too
    deep to cross. For the rest see `sweep`; uniforms [shares chains numbers].
    """
    nobody = np.zeros((0, lowest.shape[1]))
    before = 0.0
    for k in range(len(shares)):
        _resample(chains, information, pull, shares[k] - before, uniforms[k, 0, -1])
        before = shares[k]
        sweep(chains, before * information, before * pull, lowest, highest, density, free, uniforms[k], nobody)


@compiled
def _resample(chains, information, pull, share, uniform):
    """Draw as many chains from among them, in proportion to how likely this share of the evidence makes them."""
    count = len(chains)
    weight = np.empty(count)
    for chain in range(count):
        x, total = chains[chain], 0.0
        for i in range(len(x)):
            force = pull[i]
            for j in range(len(x)):
                force -= information[i, j] * x[j] / 2
            total += force * x[i]
        weight[chain] = share * total
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    old, upto, chosen = chains.copy(), weight[0], 0
    for chain in range(count):
        while upto < (chain + uniform) / count and chosen < count - 1:
            chosen += 1
            upto += weight[chosen]
        chains[chain] = old[chosen]


@compiled
def tied(information, masses, free):
    """Which of the first `masses` variables evidence ties to each other.

    Returns for each the first of those that it is tied to, directly or by others; and the clusters that arise when the
    two that are tied most firmly are joined, again and again: members in rising order, and how many they are. Of a
    cluster counts the information on its common scale: what ties its members to each other has no part in it.
    """
    root = np.arange(masses)
    clusters, sizes = np.empty((max(masses - 1, 0), masses), np.int64), np.zeros(max(masses - 1, 0), np.int64)
    common = information.copy()
    for k in range(len(sizes)):
        firmest, first, second = SMALLEST, -1, -1
        for j in range(masses):
            for i in range(j):
                tie, scale = abs(common[i, j]), common[i, i] * common[j, j]
                if root[i] != i or root[j] != j or not (free[i] and free[j]) or tie <= firmest:
                    continue
                if tie >= TIED * math.sqrt(max(scale, 0.0)):
                    firmest, first, second = tie, i, j
        if first < 0:
            return root, clusters[:k], sizes[:k]
        common[first] += common[second]
        common[:, first] += common[:, second]
        for i in range(masses):
            if root[i] == second:
                root[i] = first
            if root[i] == first:
                clusters[k, sizes[k]] = i
                sizes[k] += 1
    return root, clusters, sizes


@compiled
def _followers(information, clusters, sizes):
    """How far each member of a cluster follows where one of them goes ahead by 1, so that the evidence changes least;
    [clusters leader member]. What nothing is known of stays."""
    masses = clusters.shape[1]
    follow = np.zeros((len(sizes), masses, masses))
    for k in range(len(sizes)):
        size = sizes[k]
        known = np.empty((size, size))
        for a in range(size):
            for b in range(size):
                known[a, b] = information[clusters[k, a], clusters[k, b]]
            known[a, a] = known[a, a] * (1 + RIDGE) + LEAST_KNOWN
        _invert(known)
        for leader in range(size):
            for member in range(size):
                follow[k, leader, member] = known[member, leader] / known[leader, leader]
    return follow


@compiled
def _invert(matrix):
    """Invert a positive definite matrix in place, by Gauss and Jordan. NumPy's, compiled, would need SciPy."""
    size = len(matrix)
    for k in range(size):
        pivot = 1 / matrix[k, k]
        matrix[k, k] = 1.0
        for j in range(size):
            matrix[k, j] *= pivot
        for i in range(size):
            if i != k:
                factor = matrix[i, k]
                matrix[i, k] = 0.0
                for j in range(size):
                    matrix[i, j] -= factor * matrix[k, j]


@compiled
def _room(classes):
    """Room for intervals (two sets of lowest, highest, logarithm of weight) and for cells (place, width, weight)."""
    return np.empty((2, 3, MOST_INTERVALS)), np.empty((3, MOST_INTERVALS * CELLS))


@compiled
def _move(x, members, direction, information, pull, lowest, highest, density, uniforms, used, histogram, room):
    """Draw a step s along x_i + direction_i s of all members given everything else, and take it."""
    curvature, slope = 0.0, 0.0
    for m in range(len(members)):
        i = members[m]
        force = pull[i]
        for j in range(len(x)):
            force -= information[i, j] * x[j]
        # Masses are spread evenly, so their logarithms more densely the larger they are.
        slope += direction[m] * (force + 1.0)
        for n in range(len(members)):
            curvature += direction[m] * direction[n] * information[i, members[n]]
    intervals, found = _intervals(x, members, direction, lowest, highest, density, room[0])
    cells = _cells(intervals, found, max(curvature, 0.0), slope, room[1])
    if cells == 0:
        return
    place, width, weight = room[1]
    total = 0.0
    for k in range(cells):
        total += weight[k]
    wanted, chosen = uniforms[used] * total, cells - 1
    for k in range(cells):
        wanted -= weight[k]
        if wanted <= 0.0:
            chosen = k
            break
    bins = histogram.shape[1] // lowest.shape[1]
    for m in range(len(members)):
        i = members[m]
        if i >= histogram.shape[0]:
            continue
        for k in range(cells):
            if weight[k] > 1e-6 * total:
                histogram[i, _bin(x[i] + direction[m] * place[k], lowest[i], highest[i], bins)] += weight[k] / total
    step = place[chosen] + (uniforms[used + 1] - 0.5) * width[chosen]
    for m in range(len(members)):
        x[members[m]] += direction[m] * step


@compiled
def _intervals(x, members, direction, lowest, highest, density, room):
    """Steps at which every member stays within one of its classes: their bounds, and logarithms of their weight."""
    old, new = room[0], room[1]
    old[0, 0], old[1, 0], old[2, 0] = -math.inf, math.inf, 0.0
    found = 1
    for m in range(len(members)):
        i, count = members[m], 0
        for k in range(found):
            for c in range(lowest.shape[1]):
                if not lowest[i, c] < highest[i, c]:
                    continue
                first, last = lowest[i, c] - SMALLEST - x[i], highest[i, c] + SMALLEST - x[i]
                if abs(direction[m]) > SMALLEST:
                    first, last = first / direction[m], last / direction[m]
                    first, last = max(min(first, last), old[0, k]), min(max(first, last), old[1, k])
                elif first <= 0.0 <= last:
                    first, last = old[0, k], old[1, k]
                else:
                    continue
                if first < last and count < MOST_INTERVALS:
                    new[0, count], new[1, count], new[2, count] = first, last, old[2, k] + density[i, c]
                    count += 1
        old, new, found = new, old, count
    return old, found


@compiled
def _cells(intervals, found, curvature, slope, cells):
    """Cut the intervals, where they matter, into cells; their number. Weights are relative to the greatest."""
    nearest, deviation, peak = math.inf, math.inf, 0.0
    if curvature > SMALLEST:
        deviation, peak = 1 / math.sqrt(curvature), slope / curvature
        for k in range(found):
            nearest = min(nearest, abs(min(max(peak, intervals[0, k]), intervals[1, k]) - peak))
    place, width, weight = cells
    count, greatest = 0, -math.inf
    for k in range(found):
        first, last = intervals[0, k], intervals[1, k]
        if curvature > SMALLEST:
            close = min(max(peak, first), last)
            away = abs(close - peak)
            if away > nearest + SPAN * deviation:
                continue
            # Beyond its peak a Gaussian falls off like an exponential.
            reach = SPAN * deviation if away == 0.0 else min(SPAN * deviation, 2 * SPAN / (away * curvature))
            first, last = max(first, close - reach), min(last, close + reach)
        for cell in range(CELLS):
            w = (last - first) / CELLS
            s = first + (cell + 0.5) * w
            place[count], width[count] = s, w
            weight[count] = intervals[2, k] + (slope - curvature * s / 2) * s + math.log(w)
            greatest = max(greatest, weight[count])
            count += 1
    for k in range(count):
        weight[k] = math.exp(weight[k] - greatest)
    return count


@compiled
def _bin(logarithm, lowest, highest, bins):
    """Where a mass stands in the histogram of its classes."""
    last = 0
    for c in range(len(lowest)):
        if not lowest[c] < highest[c]:
            continue
        last = c
        if logarithm <= highest[c] + SMALLEST:
            break
    low, high = math.exp(lowest[last]), math.exp(highest[last])
    share = (math.exp(logarithm) - low) / (high - low)
    return last * bins + int(min(max(share * bins, 0.0), bins - 1.0))
