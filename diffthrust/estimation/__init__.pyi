from ._estimate import Estimate as Estimate
from ._fit import fit as fit
from ._per_log import PerLog as PerLog
from ._result import Fit as Fit
from ._status import Checks as Checks
from ._status import Status as Status
