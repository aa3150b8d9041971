from ._diagnose import diagnose as diagnose
from ._headroom import Headroom as Headroom
from ._headroom import headroom as headroom
from ._result import Diagnosis as Diagnosis
