"""A tape with inputs held at constants: what they make constant is not done again."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .numpy_rules import RULES, Shape
from .tape import NESTED, OperationTape, Step

_VANISHING = {
    "mul": slice(None), "dot_general": slice(None), "div": slice(1), "select_n": slice(1, None),
}  # fmt: skip
"""Operands of which a zero makes the result zero; of a choice, all of them."""

_EITHER = ((0, 1), (1, 0))
_NEUTRAL = {"mul": _EITHER, "add": _EITHER, "add_any": _EITHER, "sub": ((1, 0),)}
"""Operands of which a zero, or a one of a product, leaves the other as it is."""


def with_held(
    tape: OperationTape,
    always: Mapping[int, np.ndarray],
    turns: Sequence[Mapping[int, np.ndarray]],
    once: Sequence[int],
    each: Sequence[int],
) -> OperationTape:
    """The tape with some of its inputs held.

    What the values make constant is computed here, and products with zeros are left out. So a
    derivative along one parameter takes what this parameter has an effect on.

    Args:
        tape: the function.
        always: values by the places of arguments.
        turns: values of others, one set after the other.
        once: places of results that do not depend on these others.
        each: places of results that are wanted in each turn.

    Returns:
        The function of the same arguments, which does not read those that are held. Its results
        are those of `once`, then those of `each` in the first turn, in the second and so on.
    """
    varying = {tape.inputs[place] for turn in turns for place in turn}
    steps = _needed(tape, [*once, *each])
    plain, along = _split(steps, varying)
    to = _Simplified(tape)
    slots = to.placed(always)
    to.follow(plain, slots)
    outputs = [slots.get(tape.outputs[k], tape.outputs[k]) for k in once]
    for turn in turns:
        own = slots | to.placed(turn)
        to.follow(along, own)
        outputs += [own.get(tape.outputs[k], tape.outputs[k]) for k in each]
    return OperationTape(
        tape.inputs, tuple(outputs), tuple(to.shapes), to.constants, tuple(to.steps)
    )


def _needed(tape: OperationTape, places: Sequence[int]) -> list[Step]:
    """The steps that some results take."""
    wanted, steps = {tape.outputs[k] for k in places}, []
    for step in reversed(tape.steps):
        if not wanted.isdisjoint(step.outputs):
            steps.append(step)
            wanted.update(step.inputs)
    return steps[::-1]


def _split(steps: list[Step], varying: set[int]) -> tuple[list[Step], list[Step]]:
    """The steps that depend on none of some slots, and those that do."""
    without: list[Step] = []
    depending: list[Step] = []
    for step in steps:
        if varying.isdisjoint(step.inputs):
            without.append(step)
        else:
            depending.append(step)
            varying.update(step.outputs)
    return without, depending


class _Simplified:
    """Steps of a tape with other inputs; an operation on constants is a constant."""

    def __init__(self, tape: OperationTape) -> None:
        self._inputs = tape.inputs
        self.shapes, self.constants = list(tape.shapes), dict(tape.constants)
        self.steps: list[Step] = []
        self._zeros: dict[Any, int] = {}
        self._ones: set[int] = set()
        self._is_zero: set[int] = set()
        self._seen: dict[Any, tuple[int, ...]] = {}
        for slot, value in tape.constants.items():
            self._note(slot, value)

    def placed(self, values: Mapping[int, np.ndarray]) -> dict[int, int]:
        """The slots of constants, by those of the inputs in whose place they are."""
        of = {self._inputs[place]: value for place, value in values.items()}
        return {slot: self._constant(v[..., None], self.shapes[slot]) for slot, v in of.items()}

    def follow(self, steps: list[Step], slots: dict[int, int]) -> None:
        """Do the steps with other slots in place of some; those of their results are added."""
        for step in steps:
            if slots.keys().isdisjoint(step.inputs):
                self.steps.append(step)
            else:
                found = self._step(step, tuple(slots.get(k, k) for k in step.inputs))
                slots.update(zip(step.outputs, found, strict=True))

    def _constant(self, value: np.ndarray, shape: Shape) -> int:
        """The slot of an array, with members along the last axis."""
        if not value.any():
            return self._zero(shape, value.dtype)
        return self._new(value, shape)

    def _step(self, step: Step, inputs: tuple[int, ...]) -> tuple[int, ...]:
        """The slots of the results of an operation."""
        short = self._known(step, inputs)
        if short is not None:
            return (short,)
        shapes = [self.shapes[slot] for slot in step.outputs]
        if step.name not in NESTED and all(slot in self.constants for slot in inputs):
            operation = RULES[step.name](step.params, [self.shapes[slot] for slot in inputs])
            with np.errstate(all="ignore"):
                found = operation(*(self.constants[slot] for slot in inputs))
            several = found if isinstance(found, tuple) else (found,)
            return tuple(map(self._constant, several, shapes))
        # With zeros left out the derivatives along several parameters have steps in common.
        key = None if step.name in NESTED else (step.name, inputs, repr(step.params))
        outputs = self._seen.get(key)
        if outputs is None:
            outputs = tuple(range(len(self.shapes), len(self.shapes) + len(shapes)))
            self.shapes += shapes
            self.steps.append(Step(step.name, inputs, outputs, step.params))
            if key is not None:
                self._seen[key] = outputs
        return outputs

    def _known(self, step: Step, inputs: tuple[int, ...]) -> int | None:
        """The slot of what an operation with a zero or a one returns; None where it is to be done."""
        name, zeros, shape = step.name, self._is_zero, self.shapes[step.outputs[0]]
        vanishing = _VANISHING.get(name)
        if vanishing is not None:
            found = zeros.intersection(inputs[vanishing])
            if found and (name != "select_n" or zeros.issuperset(inputs[vanishing])):
                return self._zero(shape, self.constants[found.pop()].dtype)
        neutral = self._ones if name == "mul" else zeros
        for place, other in _NEUTRAL.get(name, ()):
            if inputs[place] in neutral and self.shapes[inputs[other]] == shape:
                return inputs[other]
        return None

    def _zero(self, shape: Shape, dtype: np.dtype) -> int:
        """Zeros of a shape; an axis along which an array is constant may be one long."""
        if (shape, dtype) not in self._zeros:
            self._zeros[shape, dtype] = self._new(np.zeros((1,) * (len(shape) + 1), dtype), shape)
        return self._zeros[shape, dtype]

    def _new(self, value: np.ndarray, shape: Shape) -> int:
        slot = len(self.shapes)
        self.shapes.append(shape)
        self.constants[slot] = value
        self._note(slot, value)
        return slot

    def _note(self, slot: int, value: np.ndarray) -> None:
        if not value.any():
            self._is_zero.add(slot)
        elif (value == 1).all():
            self._ones.add(slot)
