"""CasADi functions that bring their first and second derivatives along.

CasADi keeps the derivatives of a function in a cache by name, and the option ``cache`` fills it beforehand. The names
are ``jac_f``, ``fwd3_f`` for the products of the Jacobian with three directions, ``adj1_f`` for that of its transpose
with one; and in the cache of ``adj1_f``, which is the gradient of a weighted sum of the outputs, ``jac_adj1_f`` is the
Hessian of that sum. They are used where the function is called with expressions of type MX.

The text of this module is also part of the Python modules that rrrgen emits.
"""

from __future__ import annotations

from typing import Any


def with_own_derivatives(f: Any, first: Any, second: Any) -> Any:
    """The function ``f`` again, whose derivatives CasADi takes from ``first`` and ``second`` and does not derive.

    ``f`` maps three vectors (n) to y (n), and perhaps to a status. ``first`` has the results y and the three Jacobians;
    ``second``, with the further input ``weights`` (n), the gradient (3 n) of ``weights' y`` and blocks of its Hessian:
    (1, 1) as upper triangle by rows, (2, 1), (3, 1), (2, 2) as upper triangle. Needs CasADi 3.6 or newer.
    """
    import casadi as ca

    n, name, x = f.numel_in(0), f.name(), f.sx_in()
    weights = [ca.SX.sym("adj_" + label, *f.size_out(k)) for k, label in enumerate(f.name_out())]
    unused = [ca.SX.sym("out_" + label, ca.Sparsity(*f.size_out(k))) for k, label in enumerate(f.name_out())]
    given = {**dict(zip(f.name_in(), x, strict=True)), "weights": weights[0]}
    gradient, *blocks = second.call([given[label] for label in second.name_in()])
    slopes = [ca.sparsify(block) for block in first.call([given[label] for label in first.name_in()])[1:4]]
    cuts = [0, n, 2 * n, 3 * n]
    hessian = ca.blocksplit(_symmetric(n, *blocks[:4]), cuts, cuts)
    adjoint = ca.vertsplit(gradient, n)

    # two functions, because calls whose results are not needed vanish from an expression
    X, W = f.mx_in(), [ca.MX.sym("w", *weight.shape) for weight in weights]
    dy = ca.Function(name + "_slopes", x, slopes).call(X, False, True)
    hessian_function = ca.Function(name + "_hessian", [*x, weights[0]], [block for row in hessian for block in row])
    ddy = hessian_function.call([*X, W[0]], False, True)

    no_y = [ca.MX.sym("out", output.sparsity()) for output in unused]
    no_adjoint = [ca.MX.sym("out", ca.Sparsity(n, 1)) for _ in adjoint]
    flat, *status = [ca.MX(n, output.numel()) for output in unused]
    J = ca.Function(
        "jac_" + name, [*X, *no_y], [*dy, *(zeros.T for zeros in status for _ in x)], {"always_inline": True}
    )
    rows = [entry for k in range(3) for entry in (*ddy[3 * k : 3 * k + 3], flat, *status, dy[k].T, *status)]
    H = ca.Function("jac_adj1_" + name, [*X, *no_y, *W, *no_adjoint], rows, {"always_inline": True})

    arguments = [*x, *unused, *weights]
    derivatives: dict[str, Any] = {H.name(): H}
    derivatives.update(_products(H, ca.Function("adj1_" + name, arguments, adjoint), "fwd", 1, 3 * n))
    options: dict[str, Any] = {"never_inline": True, "jac_penalty": 0, "cache": derivatives}
    gradients = ca.Function("adj1_" + name, arguments, adjoint, options)
    cache = {J.name(): J, gradients.name(): gradients}
    cache.update({**_products(J, f, "fwd", 1, 3 * n), **_products(J, f, "adj", 2, n)})
    return ca.Function(name, x, f.call(x), f.name_in(), f.name_out(), {"cache": cache})


def _symmetric(n: int, first: Any, second_first: Any, third_first: Any, second: Any) -> Any:
    """The sparse symmetric matrix (3 n, 3 n) of its blocks, of which the first and the last are upper triangles."""
    import casadi as ca

    H = ca.SX(3 * n, 3 * n)
    for triangle, start in ((first, 0), (second, n)):
        pairs = [(i, j) for i in range(start, start + n) for j in range(i, start + n)]
        for k, (i, j) in enumerate(pairs):
            H[i, j] = H[j, i] = triangle[k]
    for block, start in ((second_first, n), (third_first, 2 * n)):
        H[start : start + n, :n] = block
        H[:n, start : start + n] = block.T
    return ca.sparsify(H)


def _products(jacobian: Any, f: Any, kind: str, least: int, most: int) -> dict[str, Any]:
    """Functions by name that multiply the ``jacobian`` of ``f`` ("fwd") or its transpose ("adj") with directions.

    There is one for each number of directions from ``least`` to ``most``.
    """
    import casadi as ca

    inputs = [ca.MX.sym("x", f.sparsity_in(k)) for k in range(f.n_in())]
    unused = [ca.MX.sym("out", ca.Sparsity(*f.size_out(k))) for k in range(f.n_out())]
    blocks = jacobian.call([*inputs, *unused])
    matrix = [blocks[k * f.n_in() : (k + 1) * f.n_in()] for k in range(f.n_out())]
    given, sizes = [f.sparsity_in(k) for k in range(f.n_in())], [f.size_out(k) for k in range(f.n_out())]
    if kind == "adj":
        matrix = [[row[k].T for row in matrix] for k in range(f.n_in())]
        given, sizes = [f.sparsity_out(k) for k in range(f.n_out())], [f.size_in(k) for k in range(f.n_in())]
    functions = {}
    for count in range(least, most + 1):
        seeds = [ca.MX.sym("seed", ca.repmat(sparsity, 1, count)) for sparsity in given]
        products = []
        for row, (height, width) in zip(matrix, sizes, strict=True):
            columns = [ca.reshape(seed, -1, count) for seed in seeds]
            total = ca.MX(height * width, count)
            for block, column in zip(row, columns, strict=True):
                total += block @ column
            products.append(ca.densify(ca.reshape(total, height, width * count)))
        label = f"{kind}{count}_{f.name()}"
        functions[label] = ca.Function(label, [*inputs, *unused, *seeds], products, {"always_inline": True})
    return functions
