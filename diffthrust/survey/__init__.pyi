from ._look import Look as Look
from ._look import look as look
from ._rows import ColumnRow as ColumnRow
