from .bundled import (
    NAMES as NAMES,
    bundled_card as bundled_card,
    bundled_name as bundled_name,
    bundled_text as bundled_text,
    dmsp_10 as dmsp_10,
    dmsp_20 as dmsp_20,
    open_card as open_card,
)
