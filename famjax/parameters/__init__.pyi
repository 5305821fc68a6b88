from .apart import Apart as Apart, take_apart as take_apart
from .declared import (
    Declared as Declared,
    Quantity as Quantity,
    number as number,
    parameter as parameter,
)
from .parametrised import Parametrised as Parametrised, template as template
