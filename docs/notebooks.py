"""Write the page `tutorials.md` from the scripts in `examples/`, with the output and figures of each cell.

python docs/notebooks.py            # write into docs, with the figures in docs/figures
python docs/notebooks.py FOLDER     # write into another folder
"""

import contextlib
import io
import os
import re
import sys
import tempfile
from pathlib import Path

import matplotlib as mpl

EXAMPLES = Path(__file__).parents[1] / "examples"
TUTORIALS = ("lab_tutorial", "robot_tutorial", "jax_tutorial")
_HEAD = """# Tutorials

This page shows three scripts that you can run and change. Editors that support `# %%` cells (VS Code,
Spyder, PyCharm) run the scripts cell by cell; `jupytext --to ipynb` converts them to notebooks.
`python docs/notebooks.py` generates this page.
"""
_TAIL = """## More examples

| file | contents |
|---|---|
| `examples/own_law.py` | your own bladder law, identified from readings |
| `examples/fit_optimistix.py`, `examples/fit_optax.py` | the same fit with optimistix and optax |
| `examples/nuts_blackjax.py` | the posterior, sampled by NUTS |
| `examples/mujoco_joint.py` | an antagonistic joint in MuJoCo |
| `examples/engines.py` | one comparison of models, run in one or several processes or on a cluster |
"""


def cells(script: str) -> list[tuple[bool, str]]:
    """Split a script at its `# %%` lines; return for each cell whether it is text, and its lines."""
    kinds_and_bodies = re.split(r"^# %%(.*)\n", script, flags=re.MULTILINE)[1:]
    pairs = zip(kinds_and_bodies[::2], kinds_and_bodies[1::2], strict=True)
    return [("markdown" in kind, body.strip("\n")) for kind, body in pairs]


def run(name: str, figures: Path) -> list[str]:
    """Run a tutorial; return the blocks of its page, and write its figures into a folder.

    The blocks are text, code, printed output and figures.
    """
    names: dict[str, object] = {"__name__": name}
    blocks = []
    for is_text, body in cells((EXAMPLES / f"{name}.py").read_text(encoding="utf-8")):
        if is_text:
            text = re.sub(r"^# ?", "", body, flags=re.MULTILINE)
            blocks.append(re.sub(r"^(## .*)\n", rf"\1\n\n`examples/{name}.py`\n\n", text))
            continue
        printed, before = io.StringIO(), set(Path().glob("*.svg"))
        with contextlib.redirect_stdout(printed):
            exec(compile(body, name, "exec"), names)
        blocks.append(f"```python\n{body}\n```")
        if said := printed.getvalue().strip("\n"):
            blocks.append(f"```text\n{said}\n```")
        for picture in sorted(set(Path().glob("*.svg")) - before):
            (figures / picture.name).write_bytes(picture.read_bytes())
            label = picture.stem.replace("_", " ")
            blocks.append(f"![{label}](figures/{picture.name})")
    return blocks


def write(folder: Path) -> Path:
    """Write the page and its figures into a folder; return the page's path."""
    figures = (folder / "figures").resolve()
    figures.mkdir(parents=True, exist_ok=True)
    blocks, back = [_HEAD.strip()], Path.cwd()
    page = folder.resolve() / "tutorials.md"
    with tempfile.TemporaryDirectory() as place:
        os.chdir(place)
        try:
            with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "famjax"}):
                for name in TUTORIALS:
                    blocks += run(name, figures)
        finally:
            os.chdir(back)
    page.write_text("\n\n".join([*blocks, _TAIL]), encoding="utf-8")
    return page


if __name__ == "__main__":
    print(write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent))
