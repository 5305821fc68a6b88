"""`famjax rig`: with a device, simulated, and on what was recorded."""

HELP = """Control a muscle's pressure, record a test, or simulate both; see rig/firmware.

PLAN.toml, units in the keys (psi, kPa, bar, in, mm, ...):

```toml
[plan]
pressures_psi = [20, 40, 60, 80, 100]
cycles = 3
stroke_in = 3.4
rate_in_per_s = 0.04
settle_s = 10
# photograph_every_s = 1               # `run` needs --camera for it

[rig]
circuit = "air"                       # or "water"
pressure_limit_psi = 110              # trips; without it nothing runs
proportional_counts_per_psi = 4
integral_counts_per_psi_s = 2
calibration = "calibration.toml"      # of the sensors; `simulate` needs none
# jump_limit_psi = 15                 # a change in 10 ms that trips
# integral_limits_counts = [-128, 128]
# reading_floor_counts = 61            # of one conversion; of the calibration unless given
# reading_ceiling_counts = 963         # 4.7 V
# stall_s = 3                          # at the output's limit without a rise
# frozen_s = 0.75                      # without a move while the output moves
```
"""
"""The help of the group."""

COMMANDS = {
    "device:rig_acknowledge": (
        "Acknowledge a trip, after its cause was found; nothing else clears one."
    ),
    "calibrate:rig_calibrate_pump": (
        "Step the pump of a water circuit with the controller off, for the output that holds a pressure."
    ),
    "calibrate:rig_calibrate_sensor": (
        "Calibrate the pressure transducer or the load cell at known references, into a rig's file."
    ),
    "characterise:rig_characterise": (
        "Turn a test's journal and the test machine's log into curves, figures and a dataset to fit."
    ),
    "recorded:rig_check": (
        "Check a journal: is it whole, what was lost, did the device do what its law says?"
    ),
    "recorded:rig_convert": (
        "Write a journal's records as a table with units; the journal stays the record."
    ),
    "device:rig_monitor": (
        "Show live values and a plot of the pressure; sends nothing that changes the device."
    ),
    "device:rig_ports": "List the serial ports of this computer.",
    "recorded:rig_replay": "Show a recorded test as `monitor` would have, faster.",
    "run:rig_run": (
        "Carry out a test at constant pressures and record it; the rig vents however this ends."
    ),
    "simulate:rig_serve": (
        "Run a simulated rig in real time on a TCP port or a pseudo-terminal, to try `monitor` and `run`."
    ),
    "simulate:rig_simulate": (
        "Carry out the same test against a simulated rig, far faster than real time."
    ),
}
"""Where each command is, `module:function`, and the first sentence of its help."""
