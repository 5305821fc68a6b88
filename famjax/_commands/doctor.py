"""`famjax doctor`."""

from .. import __version__


def doctor() -> int:
    """Report versions, devices, precision and name clashes; exit code 1 if something is wrong."""
    from .._doctor import problems, versions  # noqa: PLC0415

    print(f"famjax {__version__}")
    for name, version in versions().items():
        print(f"  {name} {version}")
    import jax  # noqa: PLC0415

    print("devices:", ", ".join(str(device) for device in jax.devices()))
    print(
        "float64:",
        "on" if jax.config.read("jax_enable_x64") else "off in this process (JAX's default)",
        "- the famjax commands that identify switch it on themselves",
    )
    found = problems()
    for problem in found:
        print("problem:", problem)
    if not found:
        print("no problems found")
    return 1 if found else 0
