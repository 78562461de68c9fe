"""Normal equations of a few unknowns for numba kernels: to call LAPACK costs more than to solve them."""

from __future__ import annotations

from motion_detect_ros.core.kernels import kernel


@kernel(error_model='numpy')
def solve(normal, right):  # type: ignore[no-untyped-def]
    """Solves ``normal`` (k, k), symmetric, times x = ``right`` (k,), which becomes x; False where it is singular.

    By Cholesky's factor, which the lower half of ``normal`` becomes (Golub and Van Loan 2013, section 4.2).
    """
    count = len(right)
    for j in range(count):
        for i in range(j, count):
            total = normal[i, j]
            for k in range(j):
                total -= normal[i, k] * normal[j, k]
            if i > j:
                normal[i, j] = total / normal[j, j]
            elif total > 0.0:
                normal[j, j] = total ** 0.5
            else:  # NaN too
                return False
    for i in range(count):
        for k in range(i):
            right[i] -= normal[i, k] * right[k]
        right[i] /= normal[i, i]
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            right[i] -= normal[k, i] * right[k]
        right[i] /= normal[i, i]
    return True


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
