"""ART2 as Carpenter and Grossberg (1987) describe it, in the steps of Fausett (1994), section 5.3: directions only.

Ten stages, one function each. F1 has six sublayers for an input s, with J the F2 neuron that is active:

     1  layer_w       w = s + a u
     2  layer_x       x = w / (e + |w|)
     3  layer_v       v = f(x) + b f(q)            f(y) = y where |y| > theta, else 0
     4  layer_u       u = v / (e + |v|)
     5  layer_p       p = u + d t_J                (p = u while no neuron is active)
     6  layer_q       q = p / (e + |p|)
     7  competition   y_j = t_j . p, the largest wins
     8  reset_match   |r|, r = (u + c p) / (e + |u| + c |p|); under rho - e the winner is reset, the next one tried
     9  commitment    all reset: a new neuron takes t = u / (1 - d), where learning would end (fast commitment)
    10  learning      t_J <- alpha d u + (1 + alpha d (d - 1)) t_J, F1 updated, once (slow) or until it settles (fast)

Differences from the book, each for motion vectors: f is odd, so that negative components are kept; bottom-up weights
start as the top-down ones do (0, the safest value of Fausett's bound) and follow the same law, so one matrix holds
both; a new neuron learns at once (fast commitment, slow recoding: Carpenter, Grossberg and Rosen 1991), as |r| hardly
falls for a template near 0 and the vigilance would not act; normalisation drops the length, so neuron 0 wins the
vectors that are not longer than the noise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import FloatArray

#: Rows of the (6, D) float32 array of one vector's F1 activities.
W, X, V, U, P, Q = range(6)
#: F1 settles in two updates (Fausett 1994, step 3).
F1_UPDATES = 2
#: No neuron is active.
NO_NEURON = -1


class F1Constants(NamedTuple):
    """Fausett's names."""

    a: float
    b: float
    c: float
    d: float
    e: float
    theta: float


@kernel()
def _norm(y):  # type: ignore[no-untyped-def]
    total = 0.0
    for d in range(y.shape[0]):
        total += y[d] * y[d]
    return np.sqrt(total)


@kernel()
def _normalised(y, e, out):  # type: ignore[no-untyped-def]
    """Divided by e + |y|; zero stays zero."""
    norm = e + _norm(y)
    for d in range(y.shape[0]):
        out[d] = y[d] / norm if norm > 0.0 else 0.0


@kernel()
def activation(y, theta):  # type: ignore[no-untyped-def]
    """f: what is within the noise is suppressed; odd-symmetric."""
    return y if abs(y) > theta else 0.0


@kernel()
def layer_w(s, k, f1):  # type: ignore[no-untyped-def]
    """Stage 1: the input plus feedback from u."""
    for d in range(s.shape[0]):
        f1[W, d] = s[d] + k.a * f1[U, d]


@kernel()
def layer_x(k, f1):  # type: ignore[no-untyped-def]
    """Stage 2: w normalised."""
    _normalised(f1[W], k.e, f1[X])


@kernel()
def layer_v(k, f1):  # type: ignore[no-untyped-def]
    """Stage 3: noise suppressed in both paths, bottom-up and top-down."""
    for d in range(f1.shape[1]):
        f1[V, d] = activation(f1[X, d], k.theta) + k.b * activation(f1[Q, d], k.theta)


@kernel()
def layer_u(k, f1):  # type: ignore[no-untyped-def]
    """Stage 4: v normalised."""
    _normalised(f1[V], k.e, f1[U])


@kernel()
def layer_p(prototypes, j, k, f1):  # type: ignore[no-untyped-def]
    """Stage 5: u plus the expectation of the active neuron j."""
    for d in range(f1.shape[1]):
        f1[P, d] = f1[U, d] + (k.d * prototypes[j, d] if j != NO_NEURON else 0.0)


@kernel()
def layer_q(k, f1):  # type: ignore[no-untyped-def]
    """Stage 6: p normalised."""
    _normalised(f1[P], k.e, f1[Q])


@kernel()
def competition(p, prototypes, reset):  # type: ignore[no-untyped-def]
    """Stage 7: the neuron that p excites most, but the background and those under reset; NO_NEURON: none is left."""
    winner, largest = NO_NEURON, -np.inf
    for j in range(1, prototypes.shape[0]):
        if reset[j]:
            continue
        y = 0.0
        for d in range(p.shape[0]):
            y += prototypes[j, d] * p[d]
        if y > largest:
            winner, largest = j, y
    return winner


@kernel()
def reset_match(k, f1):  # type: ignore[no-untyped-def]
    """Stage 8: |r|, 1 where expectation and input have one direction."""
    total = 0.0
    for d in range(f1.shape[1]):
        total += (f1[U, d] + k.c * f1[P, d]) ** 2
    norms = k.e + _norm(f1[U]) + k.c * _norm(f1[P])
    return np.sqrt(total) / norms if norms > 0.0 else 0.0


def commitment(u: FloatArray, k: F1Constants) -> FloatArray:
    """Stage 9: (D,) weights of a new neuron: the fixed point of stage 10 for a constant input."""
    weights: FloatArray = u / np.float32(1.0 - k.d)
    return weights


@kernel()
def learning(prototypes, j, rate, k, f1):  # type: ignore[no-untyped-def]
    """Stage 10: one update of neuron j's weights; returns the largest change."""
    largest = 0.0
    for d in range(f1.shape[1]):
        before = prototypes[j, d]
        prototypes[j, d] = rate * k.d * f1[U, d] + (1.0 + rate * k.d * (k.d - 1.0)) * before
        largest = max(largest, abs(prototypes[j, d] - before))
    return largest


@kernel()
def update_f1(s, prototypes, j, k, f1):  # type: ignore[no-untyped-def]
    """Stages 4, 1, 5, 2, 6, 3: every sublayer once, in Fausett's order, with neuron j active."""
    layer_u(k, f1)
    layer_w(s, k, f1)
    layer_p(prototypes, j, k, f1)
    layer_x(k, f1)
    layer_q(k, f1)
    layer_v(k, f1)


@kernel()
def settle(s, prototypes, k, f1):  # type: ignore[no-untyped-def]
    """F1's output for an input without feedback; leaves u up to date."""
    f1[:] = 0.0
    for _ in range(F1_UPDATES):
        update_f1(s, prototypes, NO_NEURON, k, f1)
    layer_u(k, f1)
    layer_p(prototypes, NO_NEURON, k, f1)


@kernel()
def search(prototypes, k, vigilance, reset, f1):  # type: ignore[no-untyped-def]
    """Stages 7 and 8: the neuron that resonates (NO_NEURON: all are reset), the best match, and whose it is.

    f1: settled. reset: (K,) bool, scratch. No neuron's test depends on another's, so all are tested first; the winner
    is the one that trying them one after the other, largest y first, would end with.
    """
    nearest, nearest_match = NO_NEURON, -1.0
    for j in range(1, prototypes.shape[0]):
        layer_p(prototypes, j, k, f1)
        match = reset_match(k, f1)
        reset[j] = match < vigilance - k.e
        if match > nearest_match:
            nearest, nearest_match = j, match
    layer_p(prototypes, NO_NEURON, k, f1)
    return competition(f1[P], prototypes, reset), nearest_match, nearest


@kernel()
def resonate(s, prototypes, j, rate, k, updates, tolerance, f1):  # type: ignore[no-untyped-def]
    """Neuron j learns s: stage 10 and F1 in turn, ``updates`` times at most, until no weight moves by ``tolerance``."""
    layer_p(prototypes, j, k, f1)
    layer_w(s, k, f1)
    layer_x(k, f1)
    layer_q(k, f1)
    layer_v(k, f1)
    for _ in range(updates):
        if learning(prototypes, j, rate, k, f1) < tolerance:
            return
        update_f1(s, prototypes, j, k, f1)
