from ._explore import Workbench as Workbench
from ._explore import explore as explore
