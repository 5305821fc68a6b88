from .pinhole import (
    Camera as Camera,
    Silhouette as Silhouette,
    apparent_diameter as apparent_diameter,
    profile_from_silhouette as profile_from_silhouette,
    ring_position as ring_position,
    silhouette_from_profile as silhouette_from_profile,
)
from .read import read_image as read_image
from .timestamps import Timestamp as Timestamp, read_timestamp as read_timestamp
from .tone import Tone as Tone
