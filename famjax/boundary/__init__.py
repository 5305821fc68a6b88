"""What stands between the packages and the world outside: units, files, errors of bad input.

No JAX and no physics: of famjax, this is the one room that `imaging` and `rig` import.
"""
