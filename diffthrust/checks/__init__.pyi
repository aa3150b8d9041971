from ._check import check as check
from ._result import Checked as Checked
