"""The pressure controller in the integers that the firmware computes with: PI with feed-forward.

u = v + Kp e + I, dI/dt = Ki e, e = set point - measured pressure. The same figures come out of the
C core, of its Python port and of the audit of a record: each sample determines what its output had to be.
"""

from typing import NamedTuple

TICK_HZ = 500
"""Ticks of the controller per second."""

TICKS = 1 << 32
"""A device counts its ticks modulo this: from 0 again after 99 days."""

PRESSURE_UNIT = 128
"""Set point and error are in 1/128 psi."""

GAIN_UNIT = 256
"""Gains and feed-forward are in 1/256 of (PWM counts per psi), (per psi and second), (PWM counts)."""

INTEGRAL_UNIT = PRESSURE_UNIT * GAIN_UNIT
"""The integral is in 1/32768 PWM count, so that Kp e needs no scaling."""

ZERO_UNIT = 16
"""The zero of the transducer is in 1/16 count of the converter."""

SPAN_UNIT = 64
"""The span of the transducer, psi per 1024 counts, is in 1/64 psi."""

MAX_ERROR = 32767
"""The proportional term sees at most this error [1/128 psi], 256 psi."""

_HALF_COUNT = INTEGRAL_UNIT // 2
_SPAN_SHIFT = 13  # 2^4 per count of zero and 2^16 of span, to 2^7 per psi


class ControlLaw(NamedTuple):
    """The parameters of the controller, exactly as the device stores them.

    Attributes:
        set_point: 1/128 psi, 0 to 131071.
        feed_forward: v [1/256 PWM count], 0 to 65280.
        proportional: Kp [1/256 PWM count / psi], 0 to 32767.
        integral: Ki [1/256 PWM count / (psi s)], 0 to 32767.
        low: least value of the integral term [PWM counts], -255 to 0.
        high: greatest value of the integral term [PWM counts], 0 to 255. The defaults are symmetric
            about the feed-forward and span the whole output at v = 128.
        zero: converter counts at 0 psi [1/16 count].
        span: psi per 1024 counts [1/64 psi]; the default is a 200 psi transducer of 0 to 5 V.

    >>> ControlLaw(set_point=40 * PRESSURE_UNIT).set_point_psi
    40.0
    """

    set_point: int = 0
    feed_forward: int = 0
    proportional: int = 0
    integral: int = 0
    low: int = -128
    high: int = 128
    zero: int = 0
    span: int = 200 * SPAN_UNIT

    @property
    def set_point_psi(self) -> float:
        """The set point [psi]."""
        return self.set_point / PRESSURE_UNIT

    @property
    def gains(self) -> tuple[float, float]:
        """Kp [PWM counts / psi] and Ki [PWM counts / (psi s)] as stored."""
        return self.proportional / GAIN_UNIT, self.integral / GAIN_UNIT


def pressure_error(law: ControlLaw, counts: int, ticks: int = 1) -> int:
    """Set point minus measured pressure, summed over `ticks` ticks [1/128 psi], rounded once.

    E = n set - span (16 counts - n zero) / 2^13, counts the sum of n conversions.

    >>> law = ControlLaw(set_point=40 * PRESSURE_UNIT)
    >>> pressure_error(law, 200) / PRESSURE_UNIT  # 200 counts of 200 psi / 1024 are 39.06 psi
    0.9375
    """
    measured = law.span * (ZERO_UNIT * counts - ticks * law.zero)
    return ticks * law.set_point - ((measured + (1 << (_SPAN_SHIFT - 1))) >> _SPAN_SHIFT)


def next_integral(law: ControlLaw, integral: int, error: int) -> int:
    """The integral term after one record [1/32768 PWM count], limited to [low, high].

    I + round(Ki E / 500), halves away from zero.

    Args:
        law: the law.
        integral: I before.
        error: E, `pressure_error` of the sum over the ticks of the record.

    >>> law = ControlLaw(integral=2 * GAIN_UNIT)
    >>> next_integral(law, 0, 500 * PRESSURE_UNIT) / INTEGRAL_UNIT  # 1 psi for 1 s, Ki = 2
    2.0
    """
    size = (law.integral * abs(error) + TICK_HZ // 2) // TICK_HZ
    value = integral + (size if error >= 0 else -size)
    return min(max(value, law.low * INTEGRAL_UNIT), law.high * INTEGRAL_UNIT)


def drive(law: ControlLaw, integral: int, error: int) -> int:
    """The output u [PWM counts], v + Kp e + I, rounded and limited to 0..255.

    Args:
        law: the law.
        integral: I [1/32768 PWM count].
        error: e [1/128 psi] of one tick; beyond `MAX_ERROR` it counts as that.

    >>> drive(ControlLaw(feed_forward=128 * GAIN_UNIT, proportional=4 * GAIN_UNIT), 0, 256)
    136
    """
    if not -MAX_ERROR <= error <= MAX_ERROR:
        error = MAX_ERROR if error > 0 else -MAX_ERROR
    sum_ = law.proportional * error + integral + law.feed_forward * PRESSURE_UNIT
    output = (sum_ + _HALF_COUNT) >> 15
    return 0 if output < 0 else output if output < 255 else 255
