from .jpeg_damage import (
    JpegHeader as JpegHeader,
    find_seam as find_seam,
    read_header as read_header,
)
from .pinhole import (
    Camera as Camera,
    apparent_diameter as apparent_diameter,
    ring_position as ring_position,
)
from .read import read_image as read_image, readable_part as readable_part
from .silhouette import (
    Silhouette as Silhouette,
    profile_from_silhouette as profile_from_silhouette,
    silhouette_from_profile as silhouette_from_profile,
)
from .timestamps import Timestamp as Timestamp, read_timestamp as read_timestamp
from .tone import Tone as Tone, amount_of_luma as amount_of_luma
