from .csv_writer import write_csv as write_csv
from .force_csv import (
    bundled_map_name as bundled_map_name,
    bundled_names as bundled_names,
    load_bundled as load_bundled,
    parse_specimen as parse_specimen,
    read_csv as read_csv,
)
from .force_data import ForceData as ForceData, Specimen as Specimen
from .levels import levels_of as levels_of
from .shared_errors import SharedErrors as SharedErrors
