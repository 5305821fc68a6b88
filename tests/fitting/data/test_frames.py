"""Maps, fits and sweeps as tables of pandas, xarray and notebooks."""

import numpy as np
import pytest

import famjax
import fitting


@pytest.fixture(scope="module")
def found() -> fitting.Identification:
    return fitting.identify(fitting.load_bundled("DMSP-10-250"), starts=1)


def test_a_map_is_a_table_in_si(found: fitting.Identification) -> None:
    data = found.data
    frame = data.to_pandas()
    assert list(frame) == ["force_N", "pressure_Pa", "length_m", "loaded"]
    np.testing.assert_array_equal(frame["force_N"], data.force)


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
