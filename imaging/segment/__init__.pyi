from .otsu import Split as Split, counts_of as counts_of, otsu_split as otsu_split
from .segmentation import (
    Segmentation as Segmentation,
    TapeBand as TapeBand,
    segment as segment,
)
from .tape_colour import hue_of as hue_of
