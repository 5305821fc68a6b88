"""Maps, fits and sweeps as tables of pandas, xarray and notebooks."""

import dataclasses

import numpy as np
import pytest

import famjax
import fitting
from fitting import ForceData


@pytest.fixture(scope="module")
def found() -> fitting.Identification:
    return fitting.identify(fitting.load_bundled("DMSP-10-250"), starts=1)


def test_a_fit_is_a_table_of_its_parameters(found: fitting.Identification) -> None:
    frame = found.to_pandas()
    one = found.estimate("E_1")
    assert frame.loc["E_1", "value"] == one.value
    assert frame.loc["E_1", "unit"] == "Pa"
    assert frame.loc["braid_angle", "unit"] == "rad"
    shown = found._repr_html_()
    assert all(one in shown for one in ("Identified", "E_1 3.2", "RMSE", "data:image/png"))


def test_plots_draw_on_the_axes_they_are_given(found: fitting.Identification) -> None:
    figure_module = pytest.importorskip("matplotlib.figure")
    method = type(found).plot
    for plot in (fitting.plot_isobars, fitting.plot_residuals, fitting.plot_law, method):
        axes = figure_module.Figure().subplots()
        assert plot(found, axes, "us") is axes
        assert axes.get_xlabel()
        assert axes.lines
    legend = fitting.plot_law(found, figure_module.Figure().subplots()).get_legend()
    assert legend.get_texts()[0].get_text() == "polynomial law"  # no tensile test was made
    force = fitting.plot_isobars(found, figure_module.Figure().subplots(), "si")
    drawn = np.concatenate([line.get_ydata() for line in force.lines])
    assert np.nanmax(drawn) == pytest.approx(
        float(np.max(famjax.Muscle.force(found.muscle, found.data.length.max(), 6.5e5))), rel=1e-6
    )


def test_a_table_of_pandas_is_a_map_and_back(dmsp20: ForceData) -> None:
    data = dmsp20
    frame = data.to_pandas()
    assert list(frame) == ["force_N", "pressure_Pa", "length_m", "loaded"]
    again = ForceData.from_pandas(frame, data.specimen)
    np.testing.assert_array_equal(again.force, data.force)
    np.testing.assert_array_equal(again.length, data.length)
    other = frame.rename(columns={"length_m": "length_mm"}).assign(length_mm=1e3 * data.length)
    known = {k: v for k, v in dataclasses.asdict(data.specimen).items() if v is not None}
    np.testing.assert_allclose(ForceData.from_pandas(other, known).length, data.length)
    foreign = frame.rename(columns={"force_N": "Kanal 3"}).assign(counter=range(len(frame)))
    named = fitting.read_csv(foreign, known, {"force": "Kanal 3 [N]"})
    np.testing.assert_array_equal(named.force, data.force)
    assert "Columns left aside: counter." in named.notes


def test_a_data_set_of_xarray_is_a_map_and_back(dmsp10: ForceData) -> None:
    data = dmsp10
    again = ForceData.from_xarray(data.to_xarray())
    assert again.sha256 == data.sha256
    xarray = pytest.importorskip("xarray")
    grid = xarray.Dataset(
        {"force_N": (("pressure_kPa", "length_mm"), [[30.0, np.nan], [60.0, 20.0]])},
        {"pressure_kPa": [100.0, 200.0], "length_mm": [250.0, 240.0]},
    )
    made = ForceData.from_xarray(grid, data.specimen)
    assert made.force.tolist() == [30.0, 60.0, 20.0]
    assert made.pressure.tolist() == [1e5, 2e5, 2e5]
