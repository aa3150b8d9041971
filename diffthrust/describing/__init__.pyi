from ._band import DescribingBand as DescribingBand
from ._band import uncertainty as uncertainty
from ._describe import describing_function as describing_function
from ._map import DescribingMap as DescribingMap
from ._periodic.respond import Reason as Reason
