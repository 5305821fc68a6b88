import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_wheel_holds_exactly_the_four_packages() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert wheel["packages"] == ["famjax", "fitting", "imaging", "rig"]
    for name in wheel["packages"]:
        assert (ROOT / name / "py.typed").exists()
        assert (ROOT / name / "__init__.py").exists()
