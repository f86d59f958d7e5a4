"""Which bodies are fixed to each other, given how likely every pair is by itself.

What is fixed to one body is fixed to each other: bodies fall into pieces. A division into pieces is as likely as the
product, over the pairs of which something is said, of p where the pair is in one piece and of 1 - p elsewhere.
"""

import numpy as np

from pushgraph.network.compiled.jit import compiled
from pushgraph.network.compiled.links import pair_of

SURE = 0.005
"""Pairs that are as sure as that are taken as they are: fixed, or apart unless others join them."""
MOST_OPEN = 10
"""Of so many unsure pairs that hang together all combinations are tried; of more, only the least sure."""
LEAST = 1e-6
"""Probabilities count as at least this much, and at most one less this much."""


@compiled
def fixed_pieces(fixed, apart, said, bodies, together, likeliest):
    """How likely pairs are in one piece, and which are in the likeliest division.

    fixed [batch pairs]: how likely each pair is fixed by itself. apart: how likely its likeliest other joint is. said:
    pairs of which something is said. together, likeliest [batch pairs] are filled in.
    """
    for scene in range(len(fixed)):
        _pieces_of(fixed[scene], apart[scene], said[scene], bodies, together[scene], likeliest[scene])


@compiled
def _pieces_of(fixed, apart, said, bodies, together, likeliest):
    sure = SURE
    piece, cluster, is_open = _open_pairs(fixed, said, bodies, sure)
    while _most_open(cluster, is_open, bodies) > MOST_OPEN:
        sure *= 2
        piece, cluster, is_open = _open_pairs(fixed, said, bodies, sure)
    _sure_chains(fixed, said, piece, bodies, together)
    for a in range(bodies):
        for b in range(a + 1, bodies):
            pair = pair_of(a, b, bodies)
            likeliest[pair] = piece[a] == piece[b]
            if piece[a] != piece[b]:
                together[pair] = 0.0
    for one in range(bodies):
        if cluster[one] == one:
            _try_combinations(fixed, apart, said, piece, cluster, is_open, one, bodies, together, likeliest)
    for a in range(bodies):
        for b in range(a + 1, bodies):
            pair = pair_of(a, b, bodies)
            if piece[a] != piece[b] and said[pair] and not is_open[pair]:
                together[pair] += (1 - together[pair]) * fixed[pair]


@compiled
def _open_pairs(fixed, said, bodies, sure):
    """Label of the piece of each body by what is sure; of its cluster, which unsure pairs may join; and those pairs."""
    piece, cluster = np.arange(bodies), np.arange(bodies)
    is_open = np.zeros(len(fixed), np.bool_)
    for a in range(bodies):
        for b in range(a + 1, bodies):
            pair = pair_of(a, b, bodies)
            if said[pair] and fixed[pair] >= max(1 - sure, 0.5):
                _join(piece, a, b)
                _join(cluster, a, b)
    for a in range(bodies):
        for b in range(a + 1, bodies):
            pair = pair_of(a, b, bodies)
            if said[pair] and piece[a] != piece[b] and sure < fixed[pair] < 1 - sure:
                is_open[pair] = True
                _join(cluster, a, b)
    return piece, cluster, is_open


@compiled
def _join(label, a, b):
    """Give both the lesser label of the two."""
    lesser, greater = min(label[a], label[b]), max(label[a], label[b])
    for k in range(len(label)):
        if label[k] == greater:
            label[k] = lesser


@compiled
def _most_open(cluster, is_open, bodies):
    """The number of open pairs in the cluster that has most."""
    count = np.zeros(bodies, np.int64)
    for a in range(bodies):
        for b in range(a + 1, bodies):
            count[cluster[a]] += is_open[pair_of(a, b, bodies)]
    return count.max()


@compiled
def _sure_chains(fixed, said, piece, bodies, together):
    """Of bodies that are surely in one piece: how likely the likeliest chain of fixed pairs between them is."""
    between = np.zeros((bodies, bodies))
    for a in range(bodies):
        for b in range(a + 1, bodies):
            pair = pair_of(a, b, bodies)
            if said[pair] and piece[a] == piece[b]:
                between[a, b] = between[b, a] = fixed[pair]
    for over in range(bodies):
        for a in range(bodies):
            for b in range(bodies):
                between[a, b] = max(between[a, b], between[a, over] * between[over, b])
    for a in range(bodies):
        for b in range(a + 1, bodies):
            together[pair_of(a, b, bodies)] = between[a, b]


@compiled
def _try_combinations(fixed, apart, said, piece, cluster, is_open, one, bodies, together, likeliest):
    """Weigh all divisions of a cluster."""
    first, second, count = np.empty(MOST_OPEN, np.int64), np.empty(MOST_OPEN, np.int64), 0
    for a in range(bodies):
        for b in range(a + 1, bodies):
            if cluster[a] == one and is_open[pair_of(a, b, bodies)]:
                first[count], second[count] = a, b
                count += 1
    if count == 0:
        return
    # Twice: first for the greatest weight, which the others are relative to.
    greatest, best, best_label, total = -np.inf, -np.inf, piece, 0.0
    for chosen in range(1 << count):
        label, whole = _divided(piece, first, second, count, chosen)
        if whole:
            log_weight, log_of_likeliest = _log_weights(fixed, apart, said, cluster, one, label, bodies)
            greatest = max(greatest, log_weight)
            if log_of_likeliest > best:
                best, best_label = log_of_likeliest, label
    for chosen in range(1 << count):
        label, whole = _divided(piece, first, second, count, chosen)
        if not whole:
            continue
        weight = np.exp(_log_weights(fixed, apart, said, cluster, one, label, bodies)[0] - greatest)
        total += weight
        for a in range(bodies):
            for b in range(a + 1, bodies):
                if cluster[a] == one and label[a] == label[b] and piece[a] != piece[b]:
                    together[pair_of(a, b, bodies)] += weight
    for a in range(bodies):
        for b in range(a + 1, bodies):
            if cluster[a] == one and cluster[b] == one and piece[a] != piece[b]:
                pair = pair_of(a, b, bodies)
                together[pair] /= total
                likeliest[pair] = best_label[a] == best_label[b]


@compiled
def _divided(piece, first, second, count, chosen):
    """Pieces if those of `count` open pairs are fixed whose bit is set in `chosen`; whether no other pair is then."""
    label, whole = piece.copy(), True
    for k in range(count):
        if chosen >> k & 1:
            _join(label, first[k], second[k])
    for k in range(count):
        whole &= (label[first[k]] == label[second[k]]) == (chosen >> k & 1 == 1)
    return label, whole


@compiled
def _log_weights(fixed, apart, said, cluster, one, label, bodies):
    """Logarithm of how likely a division of a cluster is, and of that with the likeliest joints between its pieces."""
    weight = of_likeliest = 0.0
    for a in range(bodies):
        for b in range(a + 1, bodies):
            pair = pair_of(a, b, bodies)
            if cluster[a] == one and cluster[b] == one and said[pair]:
                is_fixed = label[a] == label[b]
                weight += np.log(max(fixed[pair] if is_fixed else 1 - fixed[pair], LEAST))
                of_likeliest += np.log(max(fixed[pair] if is_fixed else apart[pair], LEAST))
    return weight, of_likeliest
