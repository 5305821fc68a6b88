from .bundled import (
    NAMES as NAMES,
    bundled_card as bundled_card,
    bundled_name as bundled_name,
    card_file as card_file,
    dmsp_10 as dmsp_10,
    dmsp_20 as dmsp_20,
    open_card as open_card,
)
