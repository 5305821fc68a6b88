"""A traced function as a list of NumPy operations: nothing is lowered or compiled.

The functions of a fit are a few hundred small operations. XLA takes a second to compile them, and
NumPy a few milliseconds to do them for a whole batch, so a search of a few hundred evaluations ends
before it could have begun. Only what is asked for is computed.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

import jax
import numpy as np

from .numpy_rules import RULES, SEVERAL, Shape, full, is_second, one_of_two

_INLINED = {
    "jit": "jaxpr", "pjit": "jaxpr", "closed_call": "call_jaxpr", "core_call": "call_jaxpr",
    "custom_jvp_call": "call_jaxpr", "custom_vjp_call": "call_jaxpr", "remat": "jaxpr",
    "checkpoint": "jaxpr", "eval_jaxpr": "call_jaxpr",
}  # fmt: skip
_KEPT = {
    "integer_pow": ("y",), "convert_element_type": ("new_dtype",), "reshape": ("new_sizes",),
    "broadcast_in_dim": ("shape", "broadcast_dimensions"), "squeeze": ("dimensions",),
    "transpose": ("permutation",), "rev": ("dimensions",), "concatenate": ("dimension",),
    "slice": ("start_indices", "limit_indices", "strides"), "stack": ("axis",),
    "pad": ("padding_config",), "unstack": ("axis",), "split": ("axis", "sizes"),
    "dot_general": ("dimension_numbers",),
    "iota": ("dtype", "shape", "dimension"), "cumsum": ("axis", "reverse"),
    "cumprod": ("axis", "reverse"), "sort": ("dimension", "num_keys"),
    "refuse_if": ("message",), "while": ("cond_nconsts", "body_nconsts"),
    "scan": ("length", "num_carry", "num_consts", "reverse"),
}  # fmt: skip
NESTED = {
    "while": {"cond": "cond_jaxpr", "body": "body_jaxpr"}, "scan": {"body": "jaxpr"}, "cond": {},
}  # fmt: skip
"""Primitives with tapes of their own, and where JAX keeps what these are made of."""


_Work: TypeAlias = tuple[Callable[..., Any], tuple[int, ...], tuple[int, ...], bool]
"""Operation, slots read and written, and whether it returns a tuple."""

_ALONE, _MANY, _SEVERAL = -1, -2, -3
"""In the place of a second operand: there is none, there are more, results are several."""


class UnknownPrimitiveError(Exception):
    """A primitive without a rule in NumPy: the function has to be compiled."""


@dataclasses.dataclass(frozen=True)
class Step:
    """One operation: `name` of the primitive, slots it reads and writes, its parameters."""

    name: str
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    params: dict[str, Any]


@dataclasses.dataclass(frozen=True)
class OperationTape:
    """A function as operations on numbered slots.

    Attributes:
        inputs, outputs: slots of the arguments and results.
        shapes: of all slots, for one member.
        constants: by slot.
        steps: in order.
    """

    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    shapes: tuple[Shape, ...]
    constants: dict[int, np.ndarray]
    steps: tuple[Step, ...]

    @functools.cached_property
    def run(self) -> Callable[..., list[np.ndarray]]:
        """All results of all arguments, the batch along the last axis."""
        return _runner(self, range(len(self.outputs)))

    def function(self, outputs: Sequence[int]) -> Callable[..., list[np.ndarray]]:
        """The function of all arguments whose results are those at some places only."""
        return _runner(self, outputs)


def record(function: Callable[..., Any], *examples: Any) -> OperationTape:
    """The tape of a function of arrays.

    Raises:
        UnknownPrimitiveError: it holds an operation that has no rule.
    """
    # Functions that JAX would compile by themselves are traced as parts of this one: to differentiate
    # each as a program of its own takes longer.
    with jax.disable_jit():
        closed = jax.make_jaxpr(function)(*examples)
    return _tape(closed)


class _Recorder:
    def __init__(self) -> None:
        self.shapes: list[Shape] = []
        self.constants: dict[int, np.ndarray] = {}
        self.steps: list[Step] = []
        self._seen: dict[Any, tuple[int, ...]] = {}
        self._within: set[str] = set()

    def slot(self, shape: Iterable[int]) -> int:
        self.shapes.append(tuple(int(n) for n in shape))
        return len(self.shapes) - 1

    def constant(self, value: Any, dtype: Any) -> int:
        array = np.asarray(value, dtype)
        if array.dtype.kind == "V":  # float0: the derivative of what has none, which nothing reads
            array = np.zeros(array.shape, bool)
        key = "constant", array.dtype.str, array.shape, array.tobytes()
        if key not in self._seen:
            self._seen[key] = (self.slot(array.shape),)
            self.constants[self._seen[key][0]] = array[..., None]
        return self._seen[key][0]

    def step(
        self, name: str, inputs: tuple[int, ...], params: dict[str, Any], shapes: list[Shape]
    ) -> tuple[int, ...]:
        """The slots of the results; an operation that was seen before is not done again."""
        key = name, inputs, repr(params)
        if key not in self._seen or name in NESTED:
            self._seen[key] = tuple(self.slot(shape) for shape in shapes)
            self.steps.append(Step(name, inputs, self._seen[key], params))
        return self._seen[key]

    def follow(self, jaxpr: Any, consts: Sequence[Any], inputs: Sequence[int]) -> list[int]:
        """The slots of the results of a traced function."""
        places = dict(zip(jaxpr.invars, inputs, strict=True))
        for var, value in zip(jaxpr.constvars, consts, strict=True):
            places[var] = self.constant(value, var.aval.dtype)

        def read(atom: Any) -> int:
            if hasattr(atom, "val"):
                return self.constant(atom.val, atom.aval.dtype)
            return places[atom]

        for eqn in jaxpr.eqns:
            name, operands = eqn.primitive.name, tuple(read(atom) for atom in eqn.invars)
            if name in _INLINED or name not in RULES:
                inner = eqn.params[_INLINED[name]] if name in _INLINED else self._made_of(eqn)
                inner, constants = getattr(inner, "jaxpr", inner), getattr(inner, "consts", ())
                found = self.follow(inner, constants, operands)
                self._within.discard(name)
            else:
                shapes = [var.aval.shape for var in eqn.outvars]
                found = self.step(name, operands, _params(name, eqn.params), shapes)
            places.update(zip(eqn.outvars, found, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def _made_of(self, eqn: Any) -> Any:
        """The operations that a library's own primitive stands for, traced."""
        primitive = eqn.primitive
        if primitive.name in self._within or primitive.impl is None:
            raise UnknownPrimitiveError(primitive.name)
        self._within.add(primitive.name)
        examples = [jax.ShapeDtypeStruct(v.aval.shape, v.aval.dtype) for v in eqn.invars]
        high = eqn.params.get("_prim")  # from JAX 0.12 on: of trees of arguments

        def made(*arguments: Any) -> Any:
            if high is None:
                return primitive.impl(*arguments, **eqn.params)
            tree = getattr(high, "in_tree", None)
            return high.expand(
                *(arguments if tree is None else jax.tree.unflatten(tree, arguments))
            )

        try:
            return jax.make_jaxpr(made)(*examples)
        except NotImplementedError as error:
            raise UnknownPrimitiveError(primitive.name) from error


def _tape(closed: Any) -> OperationTape:
    to = _Recorder()
    inputs = [to.slot(var.aval.shape) for var in closed.jaxpr.invars]
    outputs = to.follow(closed.jaxpr, closed.consts, inputs)
    return OperationTape(
        tuple(inputs), tuple(outputs), tuple(to.shapes), to.constants, tuple(to.steps)
    )


def _params(name: str, params: dict[str, Any]) -> dict[str, Any]:
    """What the rule of a primitive needs of its parameters, as plain numbers and tapes."""
    if name == "scan" and "ft_in" in params:  # from JAX 0.12 on
        consts, carry, _ = params["ft_in"].unpack()
        params = params | {"num_consts": len(consts), "num_carry": len(carry)}
    if name == "gather":
        numbers, mode = params["dimension_numbers"], params["mode"]
        if numbers.operand_batching_dims or numbers.start_indices_batching_dims:
            raise UnknownPrimitiveError(name)
        kept = {place: getattr(numbers, place) for place in
                ("offset_dims", "collapsed_slice_dims", "start_index_map")}  # fmt: skip
        kept |= {"slice_sizes": params["slice_sizes"], "fills": "FILL" in str(mode)}
    else:
        names = _KEPT.get(name, ())
        if not params.keys() >= set(names):
            raise UnknownPrimitiveError(name)
        kept = {key: params[key] for key in names}
        if name.startswith("reduce_"):
            kept["axes"] = params["axes"]
    if name == "reshape" and params["dimensions"] is not None:
        raise UnknownPrimitiveError(name)
    nested: dict[str, Any] = {key: _tape(params[of]) for key, of in NESTED.get(name, {}).items()}
    if name == "cond":
        nested["branches"] = tuple(_tape(branch) for branch in params["branches"])
    return {key: _simple(value) for key, value in kept.items()} | nested


def _simple(value: Any) -> Any:
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, tuple | list):
        return tuple(_simple(part) for part in value)
    if isinstance(value, int | np.integer):
        return int(value)
    return np.dtype(value).str


def _uses(tape: OperationTape, outputs: Iterable[int]) -> set[int]:
    """The places of the arguments on which some results depend."""
    wanted = {tape.outputs[place] for place in outputs}
    for step in reversed(tape.steps):
        if wanted.intersection(step.outputs):
            wanted.update(step.inputs)
    return {place for place, slot in enumerate(tape.inputs) if slot in wanted}


def _asked_of_loop(step: Step, wanted: set[int]) -> Step:
    """A loop that carries only what is asked for, and reads only what that takes."""
    of_condition, of_body = step.params["cond_nconsts"], step.params["body_nconsts"]
    read = _uses(step.params["cond"], [0])
    kept = {place for place, slot in enumerate(step.outputs) if slot in wanted}
    kept |= {place - of_condition for place in read if place >= of_condition}
    while True:
        within = _uses(step.params["body"], kept)
        more = {place - of_body for place in within if place >= of_body} - kept
        if not more:
            break
        kept |= more
    first = of_condition + of_body
    read = {place for place in read if place < of_condition}
    read |= {place + of_condition for place in within if place < of_body}
    read |= {place + first for place in kept}
    inputs = tuple(slot for place, slot in enumerate(step.inputs) if place in read)
    params = step.params | {"kept": tuple(sorted(kept)), "read": tuple(sorted(read))}
    return Step(step.name, inputs, step.outputs, params)


def _varying(
    tape: OperationTape, steps: Sequence[Step], values: list[Any], fixed: set[int]
) -> list[_Work]:
    """The steps on what varies; the others are done at once."""
    varying: list[_Work] = []
    seconds: dict[int, int] = {}  # whether a choice is the second case, by the slot that it reads
    for slot, value in tape.constants.items():
        values[slot] = value
    with np.errstate(all="ignore"):
        for step in steps:
            read = step.inputs
            operation = RULES[step.name](step.params, [tape.shapes[slot] for slot in read])
            if fixed.issuperset(read):
                found = operation(*(values[slot] for slot in read))
                for slot, value in zip(step.outputs, _several(found), strict=True):
                    values[slot] = value
                fixed.update(step.outputs)
                continue
            if step.name == "select_n" and len(read) == 3:
                if read[0] not in seconds:
                    seconds[read[0]] = len(values)
                    values.append(None)
                    varying.append((is_second, read[:1], (seconds[read[0]],), False))
                operation, read = one_of_two, (seconds[read[0]], *read)
            varying.append((operation, read, step.outputs, step.name in SEVERAL))
    return varying


def _placed(
    varying: Sequence[_Work], kept: set[int]
) -> list[tuple[Callable[..., Any], Any, int, Any]]:
    """Operations with their operands and the slots that they write; see `_runner`.

    A slot is used again after its last use, so that memory in the cache is used again.
    """
    last = {slot: place for place, (_, read, _, _) in enumerate(varying) for slot in read}
    now: dict[int, int] = {}
    free: list[int] = []
    work: list[tuple[Callable[..., Any], Any, int, Any]] = []
    for place, (operation, read, written, several) in enumerate(varying):
        slots = tuple(now.get(slot, slot) for slot in read)
        free += {now.get(slot, slot) for slot in read if last[slot] == place and slot not in kept}
        for slot in written:
            if free and slot not in kept:
                now[slot] = free.pop()
        into = tuple(now.get(slot, slot) for slot in written)
        if several:
            work.append((operation, slots, _SEVERAL, into))
        elif len(slots) == 1:
            work.append((operation, slots[0], _ALONE, into[0]))
        elif len(slots) == 2:
            work.append((operation, *slots, into[0]))
        else:
            work.append((operation, slots, _MANY, into[0]))
    return work


def _runner(tape: OperationTape, outputs: Sequence[int]) -> Callable[..., list[np.ndarray]]:
    """The tape as a function of its inputs, with nothing done that is not asked for."""
    wanted = {tape.outputs[place] for place in outputs}
    needed: list[Step] = []
    for step in reversed(tape.steps):
        if wanted.intersection(step.outputs):
            asked = _asked_of_loop(step, wanted) if step.name == "while" else step
            needed.append(asked)
            wanted.update(asked.inputs)
    values: list[Any] = [None] * len(tape.shapes)
    fixed = set(tape.constants)
    varying = _varying(tape, needed[::-1], values, fixed)
    results = [tape.outputs[place] for place in outputs]
    work = _placed(varying, fixed.union(results))
    shapes = [tape.shapes[slot] for slot in results]

    def run(*arguments: np.ndarray | None) -> list[np.ndarray]:
        v = values.copy()
        for slot, argument in zip(tape.inputs, arguments, strict=True):
            v[slot] = argument
        with np.errstate(all="ignore"):
            # Most operations take a microsecond, so that it counts what is done beside them.
            for operation, first, second, written in work:
                if second >= 0:
                    v[written] = operation(v[first], v[second])
                elif second == _ALONE:
                    v[written] = operation(v[first])
                elif second == _MANY:
                    v[written] = operation(*[v[slot] for slot in first])
                else:
                    found = operation(*[v[slot] for slot in first])
                    for slot, value in zip(written, found, strict=True):
                        v[slot] = value
        return [full(v[slot], shape) for slot, shape in zip(results, shapes, strict=True)]

    return run


def _several(found: Any) -> tuple[Any, ...]:
    return found if isinstance(found, tuple) else (found,)
