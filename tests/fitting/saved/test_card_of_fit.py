"""The card of a saved fit, by the library and by the command."""

from pathlib import Path

import numpy as np
import pytest

from famjax.__main__ import main
from famjax.cards import read_card
from fitting.prediction import predict
from fitting.saved import card_of, load_fit

# For the fit that all of these read, which then only one stage of CI makes.
pytestmark = pytest.mark.slow


def run(*arguments: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    assert not ended.value.code


@pytest.fixture(scope="module")
def fit_json(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fit")
    asked = ["--law", "neo-hookean", "--output", str(folder)]
    run("fit", "DMSP-10-250", *asked)
    return folder / "fit.json"


def test_the_command_writes_what_predict_says(
    fit_json: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    path = tmp_path / "muscle.json"
    run("card", str(fit_json), "-o", str(path), "--name", "mine")
    assert f"written: {path}" in " ".join(capsys.readouterr().out.split())
    card, fit = read_card(path), load_fit(fit_json)
    L, P = np.array([0.21, 0.24]), np.array([3e5, 5e5])
    rows = predict(fit, L, P)
    wanted = [max(row["force_N"], 0.0) for row in rows]  # predict does not cut a slack muscle
    found = card.safe().force(
        *(np.array([row[k] for row in rows]) for k in ("length_m", "pressure_Pa"))
    )
    np.testing.assert_allclose(found, wanted, rtol=1e-9)
    assert (card.name, card.draws.seed, len(card.draws.rows)) == ("mine", 0, 32)
    assert card.provenance.data_sha256 == fit.document["data"]["sha256"]
    assert card.provenance.command.startswith("famjax")
    assert " && famjax" in card.provenance.command


def test_the_covariance_is_that_of_the_fit(fit_json: Path) -> None:
    fit = load_fit(fit_json)
    known = card_of(fit, count=0).covariance
    assert known is not None
    for name, value, scale, row in zip(
        known.parameters, known.values, known.scales, range(len(known.parameters)), strict=True
    ):
        estimate = fit.document["parameters"][name]
        assert value == estimate["value"]
        std = np.sqrt(known.matrix[row][row]) * scale
        np.testing.assert_allclose(std, estimate["stderr"], rtol=1e-12)
