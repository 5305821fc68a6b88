"""Makes `examples/muscle` anew: a small characterisation folder of a muscle that is known.

    python tests/rendering/make_example.py [FOLDER]

The same version of the packages makes the same bytes.
"""

import sys
from pathlib import Path

import jax

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from rendering.folder import write_twin  # noqa: E402

TRUTH = """\
[rig]
pressures_psi = [40, 70, 100]
cycles = 1
stroke_in = 2.4
rate_in_per_s = 0.12
settle_s = 4
[camera]
pictures = 12
rows = 1000
"""


def main() -> None:
    """Write the folder, which must not have a sheet yet."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "examples" / "muscle"
    jax.config.update("jax_enable_x64", True)
    folder.mkdir(parents=True, exist_ok=True)
    truth = folder / "made-of.toml"
    truth.write_text(TRUTH, encoding="utf-8")
    write_twin(folder, seed=7, flawed=False, truth=truth)
    truth.unlink()


if __name__ == "__main__":
    main()
