"""Steps that are done once: what changes them, what stops them, what is asked of them by name."""

from pathlib import Path

import pytest

from famjax.app.folder import FolderStep, run_steps
from famjax.boundary.errors import InputError


class Work:
    """Two steps, the second on the first's file, and what was run."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.ran, self.told = folder, [], []
        self.source = folder / "source.txt"
        self.source.write_text("1")
        self.factor, self.fails = 2, False

    def steps(self) -> list[FolderStep]:
        def double(place: Path) -> None:
            self.ran.append("double")
            number = int(self.source.read_text()) * self.factor
            (place / "number.txt").write_text(str(number))

        def say(place: Path) -> None:
            self.ran.append("say")
            if self.fails:
                raise KeyboardInterrupt
            number = (self.folder / "results" / "double" / "number.txt").read_text()
            (place / "said.txt").write_text(f"it is {number}")

        return [
            FolderStep("double", [self.source], {"factor": self.factor}, (), double),
            FolderStep("say", [], {}, ("double",), say),
        ]

    def run(self, **options: tuple[str, ...]) -> list[str]:
        self.ran, self.told = [], []
        run_steps(self.steps(), self.folder / "results", tell=self.told.append, **options)
        return self.ran


@pytest.fixture
def work(tmp_path: Path) -> Work:
    """Done, but for the second step, in which it was stopped."""
    work = Work(tmp_path)
    work.fails = True
    with pytest.raises(KeyboardInterrupt):
        work.run()
    work.fails = False
    return work


def test_what_is_done_is_not_done_again_and_a_change_redoes_what_depends_on_it(work: Work) -> None:
    assert work.run() == ["say"]
    assert work.run() == []
    assert work.told == ["double: as before", "say: as before"]
    work.source.write_text("3")
    assert work.run() == ["double", "say"]
    work.factor = 5
    assert work.run() == ["double", "say"]
    said = work.folder / "results" / "say" / "said.txt"
    assert said.read_text() == "it is 15"
    said.write_text("edited")
    assert work.run() == ["say"]
    assert said.read_text() == "it is 15"


def test_steps_by_name(tmp_path: Path) -> None:
    work = Work(tmp_path)
    with pytest.raises(InputError, match="say needs double, which is not done"):
        work.run(only=("say",))
    assert work.run(only=("double",)) == ["double"]
    assert work.run(only=("say",)) == ["say"]
    assert work.run(force=("double",)) == ["double"]
    with pytest.raises(InputError, match="there is no step 'sya' here; there are double, say"):
        work.run(only=("sya",))
