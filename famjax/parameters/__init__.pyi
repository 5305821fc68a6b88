from .apart import Apart as Apart, take_apart as take_apart
from .declared import (
    Declared as Declared,
    WithUnit as WithUnit,
    number as number,
    parameter as parameter,
)
from .parametrised import Parametrised as Parametrised, template as template
