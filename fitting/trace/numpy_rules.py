"""JAX's primitives in NumPy, with the members of a batch along a last axis.

An array of shape s stands here as one of shape (*s, b), b the number of members, or 1 where all
members share it. So every rule is what it would be for one member, and the inner loops of NumPy run
over the batch. An axis along which an array is constant may have length 1 instead of its own.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

Shape: TypeAlias = tuple[int, ...]
Operation: TypeAlias = Callable[..., Any]
Rule: TypeAlias = Callable[[Mapping[str, Any], Sequence[Shape]], Operation]
"""Makes the operation of a primitive's parameters and the shapes of its operands."""

LETTERS = "abcdefghijklmnopqrstuvwxyz"


def full(x: np.ndarray, shape: Shape) -> np.ndarray:
    """The array with every axis as long as it stands for."""
    return x if x.shape[:-1] == shape else np.broadcast_to(x, (*shape, x.shape[-1]))


def _together(arrays: Sequence[np.ndarray], shapes: Sequence[Shape]) -> list[np.ndarray]:
    """The arrays in full, each for all members."""
    members = max(x.shape[-1] for x in arrays)
    return [
        x if x.shape == (*s, members) else np.broadcast_to(x, (*s, members))
        for x, s in zip(arrays, shapes, strict=True)
    ]


def _plain(function: Operation) -> Rule:
    return lambda *_: function


def _integer_pow(params: Mapping[str, Any], _: Sequence[Shape]) -> Operation:
    exponent = params["y"]
    if exponent in (2, -1):  # most are, and need no loop
        return (lambda x: x * x) if exponent == 2 else (lambda x: 1 / x)

    def power(x: np.ndarray) -> np.ndarray:
        result, square, left = None, x, abs(exponent)
        while left:
            if left & 1:
                result = square if result is None else result * square
            left >>= 1
            square = square * square if left else square
        found = np.ones_like(x) if result is None else result
        return 1 / found if exponent < 0 else found

    return power


def _divide(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    if x.dtype.kind in "fc":
        return x / y
    return (np.sign(x) * np.sign(y) * (np.abs(x) // np.abs(y))).astype(x.dtype)


def _select(which: np.ndarray, *cases: np.ndarray) -> np.ndarray:
    if which.dtype == bool:
        return np.where(which, cases[1], cases[0])
    return np.choose(which, cases)


def is_second(which: np.ndarray) -> bool:
    """Whether a choice of two cases is the second one throughout: most are guards, and are so."""
    return b"\0" not in which.tobytes()  # a third of the time of `all`


def one_of_two(second: bool, which: np.ndarray, *cases: np.ndarray) -> np.ndarray:
    """What `select_n` chooses from two cases, if it is known whether it is the second throughout."""
    return cases[1] if second else _select(which, *cases)


def _convert(params: Mapping[str, Any], _: Sequence[Shape]) -> Operation:
    dtype = np.dtype(params["new_dtype"])
    return lambda x: x.astype(dtype, copy=False)


def _broadcast_in_dim(params: Mapping[str, Any], _: Sequence[Shape]) -> Operation:
    # The axes that are there keep their order.
    there = params["broadcast_dimensions"]
    view = tuple(slice(None) if k in there else None for k in range(len(params["shape"])))
    return lambda x: x[view]


def _reshape(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    new, old = params["new_sizes"], shapes[0]
    ones = (1,) * len(new)

    def reshape(x: np.ndarray) -> np.ndarray:
        members = x.shape[-1]
        if x.size == members:  # constant along all axes
            return x.reshape((*ones, members))
        return full(x, old).reshape((*new, members))

    return reshape


def _squeeze(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    dimensions = tuple(k % len(shapes[0]) for k in params["dimensions"])
    return lambda x: np.squeeze(x, axis=dimensions)


def _transpose(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    order = (*params["permutation"], len(shapes[0]))
    return lambda x: x.transpose(order)


def _slice(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    strides = params["strides"] or (1,) * len(shapes[0])
    cuts = [slice(*ends) for ends in
            zip(params["start_indices"], params["limit_indices"], strides, strict=True)]  # fmt: skip
    whole, every = tuple(cuts), shapes[0]
    if not all(cut.stop > cut.start for cut in cuts):
        return lambda x: full(x, every)[whole]
    # A constant axis stays one.
    return lambda x: x[
        whole
        if x.shape[:-1] == every
        else tuple(c if n > 1 else slice(None) for c, n in zip(cuts, x.shape[:-1], strict=True))
    ]


def _concatenate(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    return lambda *x: np.concatenate(_together(x, shapes), axis=params["dimension"])


def _pad(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    config, shape = params["padding_config"], shapes[0]
    size = tuple(low + high + n + max(n - 1, 0) * inner
                 for n, (low, high, inner) in zip(shape, config, strict=True))  # fmt: skip
    # A negative width cuts off; so the whole is spread out first and then cut.
    spread = [slice(max(low, 0), None, inner + 1) for low, _, inner in config]

    def pad(x: np.ndarray, value: np.ndarray) -> np.ndarray:
        x, value = _together((x, value), (shape, ()))
        whole = tuple(n + max(-low, 0) + max(-high, 0)
                      for n, (low, high, _) in zip(size, config, strict=True))  # fmt: skip
        found = np.broadcast_to(value, (*whole, value.shape[-1])).copy()
        at = tuple(slice(s.start, s.start + n * s.step, s.step) if n else slice(0)
                   for s, n in zip(spread, shape, strict=True))  # fmt: skip
        found[at] = x
        cut = tuple(slice(max(-low, 0), max(-low, 0) + n)
                    for n, (low, _, _) in zip(size, config, strict=True))  # fmt: skip
        return found[cut]

    return pad


def _stack(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    axis, shape = params["axis"], shapes[0]
    size = *shape[:axis], len(shapes), *shape[axis:]
    places = [(*(slice(None),) * axis, k) for k in range(len(shapes))]

    def stack(*x: np.ndarray) -> np.ndarray:
        found = np.empty((*size, max(one.shape[-1] for one in x)), x[0].dtype)
        for place, one in zip(places, x, strict=True):
            found[place] = one  # a constant axis is as long as it stands for
        return found

    return stack


def _unstack(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    axis, shape = params["axis"], shapes[0]
    return lambda x: tuple(np.moveaxis(full(x, shape), axis, 0))


def _split(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    axis, shape, ends = params["axis"], shapes[0], np.cumsum(params["sizes"])[:-1]
    return lambda x: tuple(np.split(full(x, shape), ends, axis=axis))


def _reduce(function: np.ufunc) -> Rule:
    def rule(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
        axes, shape = tuple(params["axes"]), shapes[0]
        if all(shape[axis] == 1 for axis in axes):  # nothing to reduce
            view = tuple(0 if axis in axes else slice(None) for axis in range(len(shape)))
            return lambda x: x[view]
        return lambda x: function.reduce(full(x, shape), axis=axes)

    return rule


def _cumulative(function: Operation) -> Rule:
    def rule(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
        axis, shape = params["axis"], shapes[0]
        if params["reverse"]:
            return lambda x: np.flip(function(np.flip(full(x, shape), axis), axis=axis), axis)
        return lambda x: function(full(x, shape), axis=axis)

    return rule


def _sort(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    axis, keys = params["dimension"], params["num_keys"]

    def sort(*x: np.ndarray) -> tuple[np.ndarray, ...]:
        whole = _together(x, shapes)
        order = np.lexsort(whole[:keys][::-1], axis=axis)
        return tuple(np.take_along_axis(one, order, axis=axis) for one in whole)

    return sort


def _dot_general(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    (left_sum, right_sum), (left_each, right_each) = params["dimension_numbers"]
    left = list(LETTERS[: len(shapes[0])])
    right = list(LETTERS[len(shapes[0]) : len(shapes[0]) + len(shapes[1])])
    for mine, other in zip((*left_sum, *left_each), (*right_sum, *right_each), strict=True):
        right[other] = left[mine]
    kept = [left[k] for k in left_each]
    kept += [c for k, c in enumerate(left) if k not in (*left_sum, *left_each)]
    kept += [c for k, c in enumerate(right) if k not in (*right_sum, *right_each)]
    formula = f"{''.join(left)}...,{''.join(right)}...->{''.join(kept)}..."
    a, b = shapes
    return lambda x, y: np.einsum(formula, full(x, a), full(y, b))


def _iota(params: Mapping[str, Any], _: Sequence[Shape]) -> Operation:
    shape, dimension = params["shape"], params["dimension"]
    along = [1] * (len(shape) + 1)
    along[dimension] = shape[dimension]
    value = np.arange(shape[dimension], dtype=params["dtype"]).reshape(along)
    return lambda: value


def _gather(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    sizes, (operand_shape, index_shape) = params["slice_sizes"], shapes
    collapsed, mapped = params["collapsed_slice_dims"], params["start_index_map"]
    offset_dims, fills = params["offset_dims"], params["fills"]
    offsets = [d for d in range(len(operand_shape)) if d not in collapsed]
    count = len(index_shape) - 1 + len(offset_dims)
    batch_dims = [k for k in range(count) if k not in offset_dims]

    def gather(x: np.ndarray, indices: np.ndarray) -> np.ndarray:
        x, indices = full(x, operand_shape), full(indices, index_shape)
        members = max(x.shape[-1], indices.shape[-1])
        where: list[np.ndarray] = []
        inside = np.ones((1,) * (count + 1), bool)
        for d, size in enumerate(operand_shape):
            place = np.zeros((1,) * (count + 1), int)
            if d in mapped:
                start = indices[..., mapped.index(d), :].astype(int)
                shape = [1] * count
                for k, n in zip(batch_dims, index_shape[:-1], strict=True):
                    shape[k] = n
                start = start.reshape((*shape, start.shape[-1]))
                inside = inside & (start >= 0) & (start <= size - sizes[d])
                place = np.clip(start, 0, size - sizes[d])
            if d in offsets:
                shape = [1] * (count + 1)
                shape[offset_dims[offsets.index(d)]] = sizes[d]
                place = place + np.arange(sizes[d]).reshape(shape)
            where.append(place)
        last = np.arange(x.shape[-1]) if x.shape[-1] > 1 else np.zeros(1, int)
        found = x[(*where, last)]
        if fills:
            found = np.where(inside, found, np.nan)
        return np.broadcast_to(found, (*found.shape[:-1], members))

    return gather


def _clamp(low: np.ndarray, x: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.minimum(np.maximum(x, low), high)


def _while(params: Mapping[str, Any], _: Sequence[Shape]) -> Operation:
    of_condition, of_body = params["cond_nconsts"], params["body_nconsts"]
    condition, kept, read = params["cond"].run, params["kept"], params["read"]
    count = of_condition + len(params["body"].inputs)
    body = params["body"].function(kept)

    def loop(*given: np.ndarray) -> tuple[Any, ...]:
        x: list[Any] = [None] * count
        for place, value in zip(read, given, strict=True):
            x[place] = value
        first, second = x[:of_condition], x[of_condition : of_condition + of_body]
        carry = x[of_condition + of_body :]
        while True:
            (going,) = condition(*first, *carry)
            if not going.any():
                return tuple(carry)
            new, all_going = body(*second, *carry), going.all()
            for place, value in zip(kept, new, strict=True):
                # Members that are done stay as they are.
                carry[place] = value if all_going else np.where(going, value, carry[place])

    return loop


def _scan(params: Mapping[str, Any], shapes: Sequence[Shape]) -> Operation:
    consts, carried, length = params["num_consts"], params["num_carry"], params["length"]
    body, order = params["body"], range(length)[:: -1 if params["reverse"] else 1]

    def scan(*x: np.ndarray) -> tuple[np.ndarray, ...]:
        first, rows = consts + carried, []
        carry = x[consts:first]
        along = [full(a, s) for a, s in zip(x[first:], shapes[first:], strict=True)]
        for k in order:
            found = body.run(*x[:consts], *carry, *(a[k] for a in along))
            carry = tuple(found[:carried])
            rows.append(found[carried:])
        if params["reverse"]:
            rows.reverse()
        inner = [body.shapes[slot] for slot in body.outputs[carried:]]
        return *carry, *(
            np.stack(_together([row[k] for row in rows], [shape] * length))
            for k, shape in enumerate(inner)
        )

    return scan


def _cond(params: Mapping[str, Any], _: Sequence[Shape]) -> Operation:
    branches = params["branches"]

    def cond(which: np.ndarray, *x: np.ndarray) -> tuple[np.ndarray, ...]:
        taken = np.unique(np.clip(which.astype(int), 0, len(branches) - 1))
        found = branches[taken[0]].run(*x)
        for branch in taken[1:]:
            other = branches[branch].run(*x)
            found = [np.where(which == branch, a, b) for a, b in zip(other, found, strict=True)]
        return tuple(found)

    return cond


def _refuse_if(params: Mapping[str, Any], _: Sequence[Shape]) -> Operation:
    def checked(x: np.ndarray, bad: np.ndarray) -> np.ndarray:
        if bad.any():
            raise RuntimeError(params["message"])
        return x

    return checked


RULES: dict[str, Rule] = {
    **{name: _plain(getattr(np, function)) for name, function in {
        "add": "add", "add_any": "add", "sub": "subtract", "mul": "multiply", "neg": "negative",
        "abs": "abs", "sign": "sign", "floor": "floor", "ceil": "ceil", "square": "square",
        "sqrt": "sqrt", "cbrt": "cbrt", "exp": "exp", "exp2": "exp2", "expm1": "expm1",
        "log": "log", "log1p": "log1p", "sin": "sin", "cos": "cos", "tan": "tan", "asin": "arcsin",
        "acos": "arccos", "atan": "arctan", "atan2": "arctan2", "sinh": "sinh", "cosh": "cosh",
        "tanh": "tanh", "asinh": "arcsinh", "acosh": "arccosh", "atanh": "arctanh", "pow": "power",
        "max": "maximum", "min": "minimum", "eq": "equal", "ne": "not_equal", "lt": "less",
        "le": "less_equal", "gt": "greater", "ge": "greater_equal", "lt_to": "less",
        "le_to": "less_equal", "and": "bitwise_and", "or": "bitwise_or", "xor": "bitwise_xor",
        "not": "invert", "is_finite": "isfinite", "rem": "fmod",
    }.items()},
    "div": _plain(_divide),
    "rsqrt": _plain(lambda x: 1 / np.sqrt(x)),
    "logistic": _plain(lambda x: 1 / (1 + np.exp(-x))),
    "integer_pow": _integer_pow,
    "select_n": _plain(_select),
    "clamp": _plain(_clamp),
    "polynomial": _plain(lambda x, *c: functools.reduce(lambda y, a: y * x + a, c[::-1])),
    "one_minus_square": _plain(lambda x: (1 + x) * (1 - x)),
    **dict.fromkeys(("copy", "copy_p", "stop_gradient"), _plain(lambda x: x)),
    "convert_element_type": _convert,
    "broadcast_in_dim": _broadcast_in_dim,
    "reshape": _reshape,
    "squeeze": _squeeze,
    "transpose": _transpose,
    "rev": lambda params, shapes: lambda x: np.flip(full(x, shapes[0]), params["dimensions"]),
    "slice": _slice,
    "concatenate": _concatenate,
    "pad": _pad,
    "stack": _stack,
    "unstack": _unstack,
    "split": _split,
    "reduce_sum": _reduce(np.add),
    "reduce_prod": _reduce(np.multiply),
    "reduce_max": _reduce(np.maximum),
    "reduce_min": _reduce(np.minimum),
    "reduce_and": _reduce(np.logical_and),
    "reduce_or": _reduce(np.logical_or),
    "cumsum": _cumulative(np.cumsum),
    "cumprod": _cumulative(np.cumprod),
    "sort": _sort,
    "dot_general": _dot_general,
    "iota": _iota,
    "gather": _gather,
    "cond": _cond,
    "refuse_if": _refuse_if,
    "while": _while,
    "scan": _scan,
}  # fmt: skip
"""By the name of the primitive."""

SEVERAL = frozenset({"cond", "scan", "sort", "split", "unstack", "while"})
"""Primitives whose operations return a tuple."""
