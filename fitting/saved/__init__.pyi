from .card import card_of as card_of
from .fit_file import (
    correlations as correlations,
    fit_as_dict as fit_as_dict,
    series_as_dict as series_as_dict,
    summary_as_dict as summary_as_dict,
    versions as versions,
)
from .fit_plot import (
    law_stress as law_stress,
    plot_fit as plot_fit,
    plot_isobars as plot_isobars,
    plot_law as plot_law,
    plot_residuals as plot_residuals,
)
from .page import (
    PageTable as PageTable,
    inline_svg as inline_svg,
    page as page,
    svg_file as svg_file,
)
from .report import (
    html_report as html_report,
    notes as notes,
    tables as tables,
    verdict as verdict,
    write_fit as write_fit,
)
from .saved_fit import SavedFit as SavedFit, load_fit as load_fit
