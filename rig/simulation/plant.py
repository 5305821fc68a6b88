"""The plant: a muscle in a test machine on a pressure circuit, without sensors or controller."""

from .circuits import RunningCircuit
from .machine import TestMachine
from .muscle import SimulatedMuscle


class Plant:
    """Circuit, muscle and machine, stepped together.

    Neglected: inertia of muscle and crosshead, and the pressure drop between circuit and muscle.
    Ticks of 2 ms are within 0.02 psi (air) and 0.04 psi (water) of steps forty times finer over a
    whole test, 0.004 and 0.001 psi in the root mean square; within 0.2 psi while water is dumped.

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
        self._slide = 0.0  # friction's direction, -1 while shortening to 1 while lengthening
        self._held = muscle.at(machine.length, circuit.pressure)
        self.force = self._held[0]

    def step(self, now: float, dt: float, output: int, dump_open: bool) -> None:
        """Advance to the true time `now` [s] by dt [s] under a held output [counts]."""
        circuit, machine, muscle = self.circuit, self.machine, self.muscle
        velocity = machine.velocity
        _, volume, area, give = self._held
        circuit.step(output, dump_open, volume, area * velocity, give, dt)
        machine.step(now, dt, self.force)
        if velocity:
            # Dahl's law along the way, to first order in a step of micrometres.
            moved = abs(velocity) * dt / muscle.friction_travel
            towards = 1.0 if velocity > 0 else -1.0
            self._slide += (towards - self._slide) * (moved if moved < 1.0 else 1.0)
        self._held = held = muscle.at(machine.length, circuit.pressure)
        mean = held[0]
        self.force = mean + muscle.friction * self._slide * abs(mean)
