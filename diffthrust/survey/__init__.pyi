from ._look import Look as Look
from ._look import look as look
from ._tables import ColumnRow as ColumnRow
