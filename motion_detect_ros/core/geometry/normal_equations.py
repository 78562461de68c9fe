"""Normal equations of a few unknowns, for numba kernels."""

from __future__ import annotations

from motion_detect_ros.core.kernels import kernel


@kernel(error_model='numpy')
def tukey_sums(rows, errors, bound, normal, right):  # type: ignore[no-untyped-def]
    """The normal equations of least squares with Tukey's weights (Beaton and Tukey 1974), zero from ``bound``.

    rows: (N, k) derivatives of ``errors``, (N,). ``normal``: (k, k) becomes the sums of weight r r^T, ``right``: (k,)
    those of weight r error; the step of Gauss-Newton is minus the solution.
    """
    count = len(right)
    for i in range(count):
        right[i] = 0.0
        for j in range(count):
            normal[i, j] = 0.0
    for n in range(len(errors)):
        share = max(1.0 - (errors[n] / bound) ** 2, 0.0)
        for i in range(count):
            weighted = share * share * rows[n, i]
            right[i] += weighted * errors[n]
            for j in range(i + 1):
                normal[i, j] += weighted * rows[n, j]
    for i in range(count):
        for j in range(i):
            normal[j, i] = normal[i, j]
