from .geometry_source import (
    AbstractGeometrySource as AbstractGeometrySource,
    EstimatedSource as EstimatedSource,
    KnownSource as KnownSource,
    WrappedSource as WrappedSource,
)
from .laws import Law as Law, known_laws as known_laws
from .parameters import Parameter as Parameter
