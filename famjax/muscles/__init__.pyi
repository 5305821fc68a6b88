from .bundled import (
    NAMES as NAMES,
    bundled_card as bundled_card,
    dmsp_10 as dmsp_10,
    dmsp_20 as dmsp_20,
)
