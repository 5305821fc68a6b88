"""Makes the cards of the bundled muscles anew: `python tests/famjax/muscles/make_cards.py` writes them.

The same versions give the same numbers; date and versions in the cards change. Needed where the
identification, the choice of the model or the form of a card has changed.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

CARDS = {"DMSP-10": "DMSP-10-250", "DMSP-20": "DMSP-20-300"}
"""Name of each card, and of the bundled force map that it is made of."""


def make_cards(folder: Path) -> list[Path]:
    """Fit the bundled maps by the commands that the cards then name, and write cards into a folder."""
    written = []
    for name, data in CARDS.items():
        card = f"{name.lower()}.json"
        with tempfile.TemporaryDirectory() as scratch:
            card_of = ["card", f"{name}/fit.json", "--name", name, "--output", card]
            for command in (["fit", data, "--output", name], card_of):
                words = [sys.executable, "-m", "famjax", *command]
                subprocess.run(words, cwd=scratch, check=True, stdout=subprocess.DEVNULL)
            written.append(folder / card)
            written[-1].write_bytes((Path(scratch) / card).read_bytes())
    return written


if __name__ == "__main__":
    for path in make_cards(Path(__file__).parents[3] / "famjax" / "muscles"):
        print(path)
