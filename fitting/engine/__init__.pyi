from .batched import Batched as Batched, BatchedFit as BatchedFit
from .family import AbstractFamily as AbstractFamily
