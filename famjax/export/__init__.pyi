from .plain import TabulatedPull as TabulatedPull
from .subject import Subject as Subject, read_subject as read_subject
from .tabulate import TableErrors as TableErrors, table_errors as table_errors, tabulated as tabulated
