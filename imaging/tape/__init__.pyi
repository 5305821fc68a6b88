from .cover import behind as behind, check_cover as check_cover, tape_shows as tape_shows
from .ring import Ring as Ring, find_ring as find_ring
