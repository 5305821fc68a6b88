from .fourier import FourierFit as FourierFit, fit_fourier as fit_fourier
from .pictures import Pictures as Pictures, read_pictures as read_pictures
from .surface import ShapeSurface as ShapeSurface, shape_surface as shape_surface
