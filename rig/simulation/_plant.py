"""The plant: a muscle in a test machine on a pressure circuit, without sensors or controller."""

import math

from ._circuits import RunningCircuit
from ._machine import TestMachine
from ._muscle import SimulatedMuscle

STEP = 1e-3
"""Longest step [s] of the circuit: within 0.002 psi of an adaptive solver after the fill."""


class Plant:
    """Circuit, muscle and machine, stepped together.

    Neglected: inertia of muscle and crosshead, and the pressure drop between circuit and muscle.

    Attributes:
        circuit: in operation; its `pressure` [Pa] is the muscle's.
        muscle: force and volume.
        machine: which holds and moves the muscle.
        force: pull [N] of the muscle with its friction.
    """

    def __init__(
        self, circuit: RunningCircuit, muscle: SimulatedMuscle, machine: TestMachine
    ) -> None:
        self.circuit, self.muscle, self.machine = circuit, muscle, machine
        self._dt, self._n = 0.0, 1
        self._slide = 0.0  # friction's direction, -1 while shortening to 1 while lengthening
        self._held = muscle.at(machine.length, circuit.pressure)
        self.force = self._held[0]

    def step(self, now: float, dt: float, output: int, dump_open: bool) -> None:
        """Advance to the true time `now` [s] by dt [s] under a held output [counts]."""
        circuit, machine, muscle = self.circuit, self.machine, self.muscle
        velocity = machine.velocity
        _, volume, area, give = self._held
        if dt != self._dt:
            self._dt, self._n = dt, math.ceil(dt / STEP - 1e-6)
        n = self._n
        circuit.step(output, dump_open, volume, area * velocity, give, dt / n, n)
        machine.step(now, dt, self.force)
        if velocity:
            # Dahl's law along the way, to first order in a step of micrometres.
            moved = abs(velocity) * dt / muscle.friction_travel
            towards = 1.0 if velocity > 0 else -1.0
            self._slide += (towards - self._slide) * (moved if moved < 1.0 else 1.0)
        self._held = held = muscle.at(machine.length, circuit.pressure)
        mean = held[0]
        self.force = mean + muscle.friction * self._slide * abs(mean)
