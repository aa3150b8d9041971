from ._check import Checked as Checked
from ._check import check as check
